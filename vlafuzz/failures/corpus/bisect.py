"""bisect: which of several checkpoints in a row broke the policy, by few comparisons with a baseline.

Outcomes are noisy, so a comparison excludes no checkpoint: it makes some less likely. The checkpoint whose probability
of being broken is nearest to one half is the next one, and it is compared only until that is clear (Horstein 1963,
<https://doi.org/10.1109/TIT.1963.1057832>; Waeber et al. 2013, <https://doi.org/10.1137/120861898>). Then those around
the likeliest one are compared until it is clear that all of the loss came in this one step.

In the model behind these probabilities, a working checkpoint passes in a scene as often as the baseline's outcome there
suggests, with a beta distribution over scenes: from "always or never" to "the same in every scene". One that has lost
something passes less often in every scene, by a factor. How the loss goes on along the checkpoints has one of several
shapes: one step, two steps, a step after which it grows, a gradual loss, or no order.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from math import ceil, log2
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, logsumexp

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import percent
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.failures.corpus.regress import Recorded, Side, compare
from vlafuzz.model import Outcome, Verdict

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = Literal["one step", "two steps", "growing", "gradual", "no order"]

BLOCK = 10  # controls that are run before the probabilities are looked at again
CLEAR = 10  # a comparison ends where its checkpoint is broken or works but for this part of the error
PRIOR: dict[Shape, float] = {"one step": 0.7, "two steps": 0.14, "growing": 0.09, "gradual": 0.06, "no order": 0.01}
GRID = np.arange(21) / 20  # losses, as shares of the pass rate
STEPS = (2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20)  # of these, those that a step may have; a gradual one likewise
ALIKE = (0.1, 1.0, 10.0, 100.0)  # concentrations of the beta distribution: from "always or never" to "the same"
RATES = (np.arange(5) + 0.5) / 5  # quantiles of the pass rate, given the baseline's outcomes
_IN_WORDS: dict[Shape, str] = {
    "two steps": "the policy broke more than once",
    "growing": "the policy broke and has become worse since",
    "gradual": "the policy gets worse gradually",
    "no order": "checkpoints are better and worse in no order",
}


def believe(baseline: Floats, outcomes: Floats) -> dict[Shape, Floats]:
    """Give, by shape of the loss, the probability that it has this shape and begins with each of the checkpoints.

    Args:
        baseline: 1 where the baseline passed, 0 where it failed, NaN where that is not known: (scenes,).
        outcomes: those of the checkpoints, in order, in the same way: (checkpoints, scenes). The last one has some.
    """
    number, ran = len(outcomes), np.flatnonzero(~np.isnan(outcomes).all(axis=1))
    logs = _log_likelihoods(baseline, outcomes[ran])
    # Without an order, each checkpoint but the last has lost something or not, whatever the others have.
    lossy = logsumexp(logs[:, list(STEPS)], axis=1) - np.log(len(STEPS))
    alone = (np.logaddexp(logs[:-1, 0], lossy[:-1]) - np.log(2)).sum(axis=0) + lossy[-1]
    fits: dict[Shape, tuple[Floats, Integers]] = {"no order": (np.full(number, logsumexp(alone)), np.arange(number))}
    for shape, (losses, firsts) in _courses(number).items():
        fits[shape] = logsumexp(sum(logs[row, losses[:, at]] for row, at in enumerate(ran)), axis=1), firsts
    parts = {shape: fit + np.log(PRIOR[shape] / len(fit)) for shape, (fit, _) in fits.items()}
    whole = logsumexp(np.concatenate(list(parts.values())))
    return {shape: np.bincount(fits[shape][1], np.exp(of - whole), number).astype(float) for shape, of in parts.items()}


def _log_likelihoods(baseline: Floats, outcomes: Floats) -> Floats:
    """Give the log likelihoods of each checkpoint's outcomes: (checkpoints, losses, latent).

    Latent is what all checkpoints share: how alike scenes are, and the mean pass rate of what works (Jeffreys' prior).
    """
    rates = betaincinv((baseline == 1).sum() + 0.5, (baseline == 0).sum() + 0.5, RATES)
    alike, rate = (values.ravel() for values in np.meshgrid(ALIKE, rates, indexing="ij"))
    passing = np.stack([(alike * rate + was) / (alike + 1) for was in (0, 1)] + [rate])
    kept = np.clip(1 - GRID, 1e-6, 1)[:, None] * np.minimum(passing, 1 - 1e-6)[:, None, :]
    logs = np.zeros((len(outcomes), len(GRID), len(rate)))
    for of, chance in zip((baseline == 0, baseline == 1, np.isnan(baseline)), kept, strict=True):
        passed, failed = (outcomes[:, of] == 1).sum(1), (outcomes[:, of] == 0).sum(1)
        logs += passed[:, None, None] * np.log(chance) + failed[:, None, None] * np.log1p(-chance)
    return logs


@cache
def _courses(number: int) -> dict[Shape, tuple[Integers, Integers]]:
    """List the equally likely courses of the loss by shape, as indices of ``GRID``, and where each begins."""
    at = range(number)
    pairs, growths = list(combinations(at, 2)), list(combinations(STEPS[::2], 2))
    # A course is a line from corner to corner, of which these are the checkpoints and the losses.
    corners: dict[Shape, list[tuple[list[int], list[int]]]] = {
        "one step": [([a - 1, a], [0, loss]) for a in at for loss in STEPS],
        "two steps": [([a - 1, a, b - 1, b], [0, less, less, more]) for a, b in pairs for less, more in growths],
        "growing": [([a - 1, a, number - 1], [0, less, more]) for a in at[:-1] for less, more in growths],
        "gradual": [([a - 1, b], [0, loss]) for a, b in pairs if b - a >= 2 for loss in STEPS],
    }
    return {
        shape: (np.rint([np.interp(at, *line) for line in of]).astype(int), np.array([x[0] + 1 for x, _ in of]))
        for shape, of in corners.items()
        if of
    }


@dataclass(eq=False)
class Bisection:
    """A search for the first broken one of checkpoints in the order of their training, and what it has found.

    Args:
        probes: the controls of a corpus.
        open_side: rolls out a checkpoint, by its name; only one is open at a time.
        alpha: bound on the probability of a false alarm.
        error: a checkpoint is certain where the probability that anything else happened is at most this.
        comparisons: at most; by default as many as a search without noise takes, and two more.
        deadline: after which no rollout is begun.

    Attributes:
        last: the comparison of the last checkpoint with the baseline.
        ran: how many rollouts each checkpoint had.
        of_baseline: 1 where it passed, 0 where it failed, NaN where that is not known: (controls,).
        outcomes: likewise those of the checkpoints: (checkpoints, controls).
        chances: what follows, see ``believe``.
        in_time: whether the search ended before its deadline.
    """

    probes: Sequence[Probe]
    checkpoints: Sequence[str]
    open_side: Callable[[str], AbstractContextManager[Side]]
    baseline: Side
    alpha: float = 0.05
    error: float = 0.05
    comparisons: int | None = None
    deadline: Deadline = field(default_factory=Deadline)
    watch: Watch = SILENT

    def __post_init__(self) -> None:
        names = self.checkpoints
        if len(names) < 2 or len(set(names)) < len(names):
            message = f"expected different checkpoints, at least two, got {', '.join(names) or 'none'}"
            raise UsageError(message, hint="name them in the order of their training, the oldest first")
        recorded = isinstance(self.baseline, Recorded)
        self.of_baseline: Floats = np.array([float(probe.passed) if recorded else np.nan for probe in self.probes])
        self.outcomes: Floats = np.full((len(names), len(self.probes)), np.nan)
        self.ran, self.in_time = [0] * len(names), True

    def search(self) -> Self:
        """Compare the last checkpoint, and if it is worse others, until one is certain or no more may be compared."""
        most = self.comparisons or ceil(log2(len(self.ran))) + 2
        said = f"{len(self.ran)} checkpoints: at most {most} comparisons of at most {len(self.probes)} rollouts each"
        self.watch.note(said)
        with self.open_side(self.checkpoints[-1]) as side:
            doing, deadline = f"rollouts of {side.name}", self.deadline
            self.last = compare(
                self.probes, side, self.baseline, alpha=self.alpha, deadline=deadline, watch=self.watch, doing=doing
            )
        pairs = [pair for scene in self.last.compared for pair in scene.pairs]
        if not self.last.tells:
            raise _unjudged(side, self.last.verdict, [outcome for pair in pairs for outcome in reversed(pair)])
        self.ran[-1], self.in_time = len(pairs), self.last.stopped != "time"
        self.of_baseline[: len(pairs)] = [_passed(pair.baseline) for pair in pairs]
        self.outcomes[-1, : len(pairs)] = [_passed(pair.policy) for pair in pairs]
        self.chances = believe(self.of_baseline, self.outcomes)
        for _ in range(most - 1):
            index = self._next()
            if index is None or self.deadline.passed:
                self.in_time &= index is None
                break
            with self.open_side(self.checkpoints[index]) as side:
                self._compare(index, side)
        return self

    def _next(self) -> int | None:
        """The checkpoint to be compared next; None where one is certain, or nothing is left to be run."""
        if self.certain or not self.alarm:
            return None
        left = [index for index, ran in enumerate(self.ran) if ran < len(self.probes)]
        likely = int(self._if_one_step.argmax())
        if self._if_one_step[likely] >= 1 - self.error:
            # If it is one step, it is this; whether it is, the checkpoints around it tell, and the last.
            near = {likely - 1, likely, len(self.ran) - 1} & set(left)
            return min(near, key=self.ran.__getitem__, default=None)
        return min(left[:-1] or left, key=lambda index: abs(self.broken(index) - 0.5), default=None)

    def _compare(self, index: int, side: Side) -> None:
        """Run a checkpoint in further controls until it is clear whether it is broken, or until all is."""
        located, told = self._if_one_step.max() >= 1 - self.error, False
        while not (told or self.certain or self.deadline.passed or self.ran[index] == len(self.probes)):
            block = range(len(self.probes))[self.ran[index] :][:BLOCK]
            unknown = [place for place in block if np.isnan(self.of_baseline[place])]
            of_baseline = self._roll_out(self.baseline, unknown, self.of_baseline)
            of_policy = self._roll_out(side, block, self.outcomes[index])
            self.ran[index] += len(of_policy)
            if not (self.deadline.passed or self.judged(index)[list(block)].any()):
                raise _unjudged(side, "no rollout could be judged", of_policy + of_baseline)
            self.chances = believe(self.of_baseline, self.outcomes)
            told = not located and not self.error / CLEAR < self.broken(index) < 1 - self.error / CLEAR

    def _roll_out(self, side: Side, places: Sequence[int], passed: Floats) -> list[Outcome]:
        """Fill in what becomes of the controls in these places, until the deadline."""
        outcomes: list[Outcome] = []
        answers = side.answers([(self.probes[place], 0) for place in places])
        for place in places:
            if self.deadline.passed:
                break
            outcomes.append(next(answers))
            passed[place] = _passed(outcomes[-1])
            self.watch.progress(f"rollouts of {side.name}", place + 1, len(self.probes))
        return outcomes

    @property
    def alarm(self) -> bool:
        """Whether the last checkpoint is worse than the baseline; else there is nothing to be found."""
        return self.last.alarm

    @property
    def certain(self) -> bool:
        """Whether all of the loss came with the one that is named, but for the error."""
        return self.alarm and bool(self.chances["one step"].max() >= 1 - self.error)

    @property
    def _first(self) -> Floats:
        """Probability of each checkpoint to be the first that has lost something."""
        return sum(self.chances.values(), np.zeros(len(self.ran)))

    @property
    def _if_one_step(self) -> Floats:
        """The same probabilities, if the loss comes in one step."""
        one_step: Floats = self.chances["one step"]
        return one_step / one_step.sum() if one_step.sum() > 0 else self._first

    def broken(self, index: int) -> float:
        """Probability that a checkpoint has lost something, if the loss comes in one step."""
        return min(float(self._if_one_step[: index + 1].sum()), 1.0)

    def judged(self, index: int) -> NDArray[np.bool_]:
        """The controls in which both a checkpoint and the baseline could be judged."""
        return np.asarray(np.isfinite(self.of_baseline + self.outcomes[index]), dtype=np.bool_)

    @property
    def probabilities(self) -> dict[str, float]:
        """That a checkpoint is the first broken one; empty without an alarm."""
        return dict(zip(self.checkpoints, self._first.tolist(), strict=True)) if self.alarm else {}

    @property
    def likely(self) -> list[str]:
        """The fewest checkpoints that hold the first broken one, but for the error; the likeliest first."""
        names = sorted(self.probabilities, key=self.probabilities.__getitem__, reverse=True)
        held = np.cumsum([self.probabilities[name] for name in names])
        return names[: int(np.searchsorted(held, 1 - self.error - 1e-12)) + 1]

    @property
    def named(self) -> str | None:
        """The likeliest first broken checkpoint; None without an alarm."""
        return next(iter(self.likely), None)

    @property
    def shapes(self) -> dict[Shape, float]:
        """Probabilities of how the loss came; empty without an alarm."""
        return {shape: float(of.sum()) for shape, of in self.chances.items()} if self.alarm else {}

    @property
    def shape(self) -> Shape | None:
        """The most likely one of these; None without an alarm."""
        return max(self.shapes, key=self.shapes.__getitem__, default=None)

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        if self.shape is None:
            return self.last.verdict
        at, *others = (f"{name} ({_said(self.probabilities[name])})" for name in self.likely)
        if self.certain:
            return f"the first broken checkpoint is {at}"
        also = f"; it may also be {', '.join(others)}" if others else ""
        seen = f"{_IN_WORDS[self.shape]} ({_said(self.shapes[self.shape])}); " if self.shape in _IN_WORDS else ""
        return f"{seen}the first broken checkpoint is probably {at}{also}"


def _passed(outcome: Outcome) -> float:
    return float(outcome.passed) if outcome.judged else np.nan


def _said(probability: float) -> str:
    """A probability in words, never as 100 %."""
    return percent(probability) if probability < 0.999 else "over 99.9%"


def _unjudged(side: Side, said: str, outcomes: Iterable[Outcome]) -> PrerequisiteError:
    details = (f": {outcome.detail}" for outcome in outcomes if outcome.verdict is Verdict.ERROR)
    hint = "`vlafuzz doctor --policy` examines a checkpoint; were the rollouts too few, give more --time or controls"
    return PrerequisiteError(f"{side.name}: {said}{next(details, '')}", hint=hint)
