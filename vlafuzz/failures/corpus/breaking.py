"""What became of checkpoints in a row, and which of them broke first, as probabilities from noisy outcomes.

A working checkpoint passes in a scene with the probability that the baseline's outcome there suggests. Over scenes,
this has a beta distribution: anything from "the same in every scene" to "always or never". One that has lost something
passes less often in every scene, by a factor. How the loss goes on along the checkpoints has one of several shapes: one
step, two steps, a step after which it grows, a gradual loss, or no order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = Literal["one step", "two steps", "growing", "gradual", "no order"]

PRIOR: dict[Shape, float] = {"one step": 0.7, "two steps": 0.14, "growing": 0.09, "gradual": 0.06, "no order": 0.01}
GRID = np.arange(21) / 20  # losses, as shares of the pass rate
STEPS = (2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20)  # of these, those that a step may have; a gradual one likewise
# Concentrations of the beta distribution: from "always or never" to "the same".
ALIKE = (0.1, 1.0, 10.0, 100.0)
RATES = (np.arange(5) + 0.5) / 5  # quantiles of the pass rate, given the baseline's outcomes


@dataclass(frozen=True, eq=False)
class Belief:
    """What is known, given that the last checkpoint is worse.

    Attributes:
        first: probability of each checkpoint to be the first that has lost something.
        one_step: probability that it has, and that nothing changes after it.
        shapes: probability of each shape.
    """

    first: Floats
    one_step: Floats
    shapes: dict[Shape, float]

    @property
    def if_one_step(self) -> Floats:
        """Probability of each checkpoint to be the first, if the loss comes in one step."""
        total = float(self.one_step.sum())
        return self.one_step / total if total > 0 else self.first

    @staticmethod
    def unknown(checkpoints: int) -> "Belief":
        """Before any outcome."""
        return Belief(np.full(checkpoints, 1 / checkpoints), np.zeros(checkpoints), dict(PRIOR))


def believe(baseline: Floats, outcomes: Floats) -> Belief:
    """What the outcomes say.

    Args:
        baseline: 1 where the baseline passed, 0 where it failed, NaN where that is not known: (scenes,). outcomes:
        likewise those of the checkpoints, in order: (checkpoints, scenes).
    """
    number = len(outcomes)
    ran = np.flatnonzero(~np.isnan(outcomes).all(axis=1))
    logs = _log_likelihoods(baseline, outcomes[ran])  # (ran, losses, latent)
    by_shape: dict[Shape, tuple[Floats, Integers]] = {}
    for shape, (profiles, firsts) in _profiles(number).items():
        total = sum((logs[row, profiles[:, at]] for row, at in enumerate(ran)), np.zeros(logs.shape[-1]))
        total = np.broadcast_to(total, (len(profiles), logs.shape[-1]))
        by_shape[shape] = (logsumexp(total, axis=1) - np.log(len(profiles)), firsts)
    # Without an order, each checkpoint has lost something or not, whatever the others have.
    lossy = logsumexp(logs[:, list(STEPS)], axis=1) - np.log(len(STEPS))
    alone = (np.logaddexp(logs[:-1, 0], lossy[:-1]) - np.log(2)).sum(0) + lossy[-1:].sum(0)
    none = np.full(number, logsumexp(alone) - np.log(number))
    by_shape["no order"] = (none, np.arange(number))
    weights = {shape: np.log(PRIOR[shape]) + values for shape, (values, _) in by_shape.items()}
    all_of = logsumexp(np.concatenate(list(weights.values())))
    first, one_step = np.zeros(number), np.zeros(number)
    for shape, (_, firsts) in by_shape.items():
        np.add.at(first, firsts, np.exp(weights[shape] - all_of))
    np.add.at(one_step, by_shape["one step"][1], np.exp(weights["one step"] - all_of))
    shapes = dict.fromkeys(PRIOR, 0.0)
    shapes |= {shape: float(np.exp(logsumexp(values) - all_of)) for shape, values in weights.items()}
    return Belief(first, one_step, shapes)


def _log_likelihoods(baseline: Floats, outcomes: Floats) -> Floats:
    """Of each checkpoint's outcomes: (checkpoints, losses, latent).

    Latent are how alike scenes are, and the mean pass rate of what works (Jeffreys' prior, given the baseline), both of
    which all checkpoints share.
    """
    rates = _rates(int((baseline == 1).sum()), int((baseline == 0).sum()))
    alike, rate = (values.ravel() for values in np.meshgrid(ALIKE, rates, indexing="ij"))
    passing = np.stack([(alike * rate + was) / (alike + 1) for was in (0, 1)] + [rate])
    kept = np.clip(1 - GRID, 1e-6, 1)[:, None] * np.minimum(passing, 1 - 1e-6)[:, None, :]
    logs = np.zeros((len(outcomes), len(GRID), len(rate)))
    for of, chance in zip((baseline == 0, baseline == 1, np.isnan(baseline)), kept, strict=True):
        passed, failed = (outcomes[:, of] == 1).sum(1), (outcomes[:, of] == 0).sum(1)
        logs += passed[:, None, None] * np.log(chance) + failed[:, None, None] * np.log1p(-chance)
    return logs


@cache
def _rates(passed: int, failed: int) -> Floats:
    from scipy.special import betaincinv

    return np.asarray(betaincinv(passed + 0.5, failed + 0.5, RATES), dtype=np.float64)


@cache
def _profiles(number: int) -> dict[Shape, tuple[Integers, Integers]]:
    """By shape, equally likely courses of the loss, as indices of ``GRID``, and where each begins."""
    at = np.arange(number)
    one = [((at >= first) * loss, first) for first in at for loss in STEPS]
    two = [
        (np.where(at >= second, more, (at >= first) * less), first)
        for first, second in combinations(at, 2)
        for less, more in combinations(STEPS[::2], 2)
    ]
    growing = [
        (np.rint((at >= first) * (less + (more - less) * (at - first) / (number - 1 - first))), first)
        for first in at[:-1]
        for less, more in combinations(STEPS[::2], 2)
    ]
    ramps = [(first, last) for first, last in combinations(at, 2) if last - first >= 2]
    gradual = [
        (np.rint(np.clip((at - first + 1) / (last - first + 1), 0, 1) * loss), first)
        for first, last in ramps
        for loss in STEPS
    ]
    found: dict[Shape, list[tuple[Any, Any]]] = {"one step": one, "two steps": two, "growing": growing}
    found |= {"gradual": gradual} if gradual else {}
    return {
        shape: (np.array([course for course, _ in of]).astype(int), np.array([first for _, first in of]))
        for shape, of in found.items()
    }


def likeliest(probabilities: Sequence[float], share: float) -> tuple[int, ...]:
    """The fewest checkpoints, by index, that have this share of the probability; the likeliest first."""
    order = np.argsort(-np.asarray(probabilities), kind="stable")
    enough = int(np.searchsorted(np.cumsum(np.asarray(probabilities)[order]), share - 1e-12)) + 1
    return tuple(int(index) for index in order[:enough])
