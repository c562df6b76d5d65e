"""bisect: which of several checkpoints in a row broke the policy, by few comparisons with a baseline.

Outcomes are noisy, so a comparison excludes no checkpoint: it makes some less likely (see ``breaking``). The checkpoint
whose probability of being broken is nearest to one half is the next one, and it is compared only until that is clear
(Horstein 1963, <https://doi.org/10.1109/TIT.1963.1057832>; Waeber et al. 2013, <https://doi.org/10.1137/120861898>).
Then those around the likeliest one are compared until it is clear that all of the loss came in this one step. All
comparisons are in the controls of a corpus, see ``regress``.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import percent
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.corpus.breaking import Belief, Shape, believe, likeliest
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.failures.corpus.regress import Comparison, compare
from vlafuzz.failures.corpus.sides import Recorded, Remembered, Side

BLOCK = 10  # controls that are run before the probabilities are looked at again
CLEAR = 10  # a comparison ends where its checkpoint is broken or works but for this part of the error


@dataclass(frozen=True, kw_only=True)
class Step:
    """The comparison of one checkpoint with the baseline, in some controls.

    Attributes:
        of: controls that both could be judged in; of these each passed so many.
        broken: probability that the checkpoint has, after this comparison, if the loss comes in one step.
    """

    checkpoint: str
    of: int
    passed: int
    baseline_passed: int
    broken: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Bisection:
    """The result.

    Attributes:
        error: a checkpoint is named with certainty if the probability of anything else is at most this. last: the
        comparison of the last checkpoint with the baseline.
        steps: all comparisons, this one first.
        belief: what follows from all outcomes, given that the last checkpoint is broken.
        rollouts: of checkpoints.
        in_time: whether the search ended before its deadline.
    """

    checkpoints: tuple[str, ...]
    baseline: str
    error: float
    last: Comparison
    steps: tuple[Step, ...]
    belief: Belief
    rollouts: int
    in_time: bool = True

    @property
    def alarm(self) -> bool:
        """Whether the last checkpoint is worse than the baseline; else there is nothing to be found."""
        return self.last.alarm

    @property
    def probabilities(self) -> tuple[float, ...]:
        """That a checkpoint is the first broken one."""
        return tuple(map(float, self.belief.first))

    @property
    def named(self) -> str | None:
        """The likeliest first broken checkpoint; None without an alarm."""
        return self.checkpoints[self.likely[0]] if self.alarm else None

    @property
    def certain(self) -> bool:
        """Whether all of the loss came with the one that is named, but for the error."""
        return self.alarm and bool(self.belief.one_step.max() >= 1 - self.error)

    @property
    def likely(self) -> tuple[int, ...]:
        """Indices of the fewest checkpoints that hold the first broken one, but for the error."""
        return likeliest(self.probabilities, 1 - self.error) if self.alarm else ()

    @property
    def shape(self) -> Shape | None:
        """How the loss came, most likely; None without an alarm."""
        shapes = self.belief.shapes
        likeliest_one: Shape = max(shapes, key=lambda shape: shapes[shape])
        return likeliest_one if self.alarm else None

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        if not self.alarm:
            return self.last.verdict
        at, *others = (f"{self.checkpoints[at]} ({_in_words(self.probabilities[at])})" for at in self.likely)
        if self.certain:
            return f"the first broken checkpoint is {at}"
        also = f"; it may also be {', '.join(others)}" if others else ""
        probably = f"the first broken checkpoint is probably {at}{also}"
        if self.shape in (None, "one step"):
            return probably
        seen = {
            "two steps": "the policy broke more than once",
            "growing": "the policy broke and has become worse since",
            "gradual": "the policy gets worse gradually",
            "no order": "checkpoints are better and worse in no order",
        }[self.shape]
        return f"{seen} ({_in_words(self.belief.shapes[self.shape])}); {probably}"


def _in_words(probability: float) -> str:
    """Never 100 %."""
    return percent(probability) if probability < 0.999 else "over 99.9%"


def check_checkpoints(checkpoints: Sequence[str]) -> None:
    """Raise a UsageError if there are fewer than two, or one twice."""
    if len(checkpoints) < 2 or len(set(checkpoints)) < len(checkpoints):
        message = f"expected different checkpoints, at least two, got {', '.join(checkpoints) or 'none'}"
        raise UsageError(message, hint="name them in the order of their training, the oldest first")


def most_comparisons(checkpoints: int) -> int:
    """By default: those of a search without noise, and two more."""
    return ceil(log2(checkpoints)) + 2


def bisect(
    probes: Sequence[Probe],
    checkpoints: Sequence[str],
    open_side: Callable[[str], AbstractContextManager[Side]],
    baseline: Side,
    *,
    alpha: float = 0.05,
    error: float = 0.05,
    comparisons: int | None = None,
    deadline: Deadline | None = None,
    watch: Watch = SILENT,
) -> Bisection:
    """Name the first broken one of checkpoints in the order of their training.

    First the last one is compared with the baseline, as ``regress.compare`` does.

    Args:
        probes: the controls.
        open_side: rolls out a checkpoint, by its name.
        alpha: bound on the probability of a false alarm.
        error: the search ends where the probability that anything else happened is at most this. comparisons: at most;
        by default ``most_comparisons``.
        deadline: after which no rollout is begun.

    Raises:
        UsageError: there are fewer than two checkpoints, or one twice.
        PrerequisiteError: rollouts of a checkpoint cannot be judged, or no alarm is possible.
    """
    check_checkpoints(checkpoints)
    deadline = deadline or Deadline()
    search = _Search(probes, checkpoints, baseline, error, deadline, watch)
    with open_side(checkpoints[-1]) as side:
        last = search.begin(side, alpha)
    in_time = last.stopped != "time"
    while last.alarm and len(search.steps) < (comparisons or most_comparisons(len(checkpoints))):
        index = search.next()
        if index is None:
            break
        in_time = not deadline.passed
        if not in_time:
            break
        with open_side(checkpoints[index]) as side:
            search.compare(index, side)
    return Bisection(
        checkpoints=tuple(checkpoints),
        baseline=baseline.name,
        error=error,
        last=last,
        steps=tuple(search.steps),
        belief=search.belief,
        rollouts=sum(search.ran),
        in_time=in_time,
    )


class _Search:
    """The outcomes so far, and what follows from them."""

    def __init__(
        self,
        probes: Sequence[Probe],
        checkpoints: Sequence[str],
        baseline: Side,
        error: float,
        deadline: Deadline,
        watch: Watch,
    ) -> None:
        self._probes, self._checkpoints, self._error, self._watch = probes, checkpoints, error, watch
        self._deadline = deadline
        self._baseline = Remembered(baseline)
        recorded = isinstance(baseline, Recorded)
        self._of_baseline = np.array([float(probe.passed) if recorded else np.nan for probe in probes])
        self._outcomes = np.full((len(checkpoints), len(probes)), np.nan)
        self.ran = [0] * len(checkpoints)  # rollouts
        self.steps: list[Step] = []
        self.belief = Belief.unknown(len(checkpoints))

    def begin(self, side: Side, alpha: float) -> Comparison:
        """Compare the last checkpoint with the baseline until it is shown to be worse."""
        last = len(self._checkpoints) - 1
        compared = self._compared(last, self._probes, side, alpha=alpha)
        if not compared.tells:
            raise unjudged(side, compared)
        self._see(last, compared)
        self._end(last, [compared])
        return compared

    def next(self) -> int | None:
        """The checkpoint to be compared next; None where one is named, or nothing is left to be run."""
        if self._certain:
            return None
        left = [index for index in range(len(self.ran)) if self.ran[index] < len(self._probes)]
        if_one_step = self.belief.if_one_step
        likely = int(if_one_step.argmax())
        if if_one_step[likely] >= 1 - self._error:
            # If it is one step, it is this; whether it is, the checkpoints around it tell, and the last.
            near = {likely - 1, likely, len(self.ran) - 1} & set(left)
            return min(near, key=self.ran.__getitem__, default=None)
        return min(left[:-1] or left, key=lambda index: abs(self._broken(index) - 0.5), default=None)

    def compare(self, index: int, side: Side) -> None:
        """Run a checkpoint in further controls until it is clear whether it is broken, or until all is."""
        blocks: list[Comparison] = []
        clear = self._error / CLEAR
        located = self.belief.if_one_step.max() >= 1 - self._error
        while block := self._probes[self.ran[index] :][:BLOCK]:
            compared = self._compared(index, block, side, whole=True)
            over = compared.stopped == "time"
            if not (compared.controls.policy.of or over):
                raise unjudged(side, compared)
            self._see(index, compared)
            blocks.append(compared)
            told = not located and not clear < self._broken(index) < 1 - clear
            if over or told or self._certain:
                break
        self._end(index, blocks)

    def _compared(self, index: int, probes: Sequence[Probe], side: Side, **options: Any) -> Comparison:
        options |= {"deadline": self._deadline, "watch": self._watch, "doing": f"rollouts of {side.name}"}
        return compare(probes, side, self._baseline, before=self.ran[index], most=len(self._probes), **options)

    @property
    def _certain(self) -> bool:
        return bool(self.belief.one_step.max() >= 1 - self._error)

    def _see(self, index: int, compared: Comparison) -> None:
        """Keep the outcomes of the next controls."""
        pairs = [pair for scene in compared.compared for pair in scene.pairs]
        for place, pair in enumerate(pairs, start=self.ran[index]):
            if pair.baseline.judged:
                self._of_baseline[place] = pair.baseline.passed
            if pair.policy.judged:
                self._outcomes[index, place] = pair.policy.passed
        self.ran[index] += len(pairs)
        self.belief = believe(self._of_baseline, self._outcomes)

    def _end(self, index: int, parts: Sequence[Comparison]) -> None:
        tallies = [part.controls for part in parts]
        self.steps.append(
            Step(
                checkpoint=self._checkpoints[index],
                of=sum(tally.policy.of for tally in tallies),
                passed=sum(tally.policy.count for tally in tallies),
                baseline_passed=sum(tally.baseline.count for tally in tallies),
                broken=self._broken(index),
            )
        )

    def _broken(self, index: int) -> float:
        """The probability that a checkpoint is broken, if the loss comes in one step."""
        return min(float(self.belief.if_one_step[: index + 1].sum()), 1.0)


def unjudged(side: Side, compared: Comparison) -> PrerequisiteError:
    """The error where no verdict on a policy is possible."""
    if compared.stopped == "time":
        message = f"{side.name}: --time is over: {compared.verdict}"
        return PrerequisiteError(message, hint="give more --time")
    if compared.controls.policy.of and not compared.lacking:
        return PrerequisiteError(f"{side.name}: {compared.verdict}", hint="give a corpus with more controls")
    details = (f": {scene.detail}" for scene in compared.compared if scene.standing == "error")
    judged = compared.controls.policy.of
    number = f"{judged} of {compared.tried} rollouts" if judged else "no rollout"
    message = f"{side.name}: cannot tell: {number} could be judged{next(details, '')}"
    return PrerequisiteError(message, hint="`vlafuzz doctor --policy` examines a checkpoint")
