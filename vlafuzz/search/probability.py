"""The probability that a policy fails in a random scene, from a guided search.

It rests on plain draws: scenes that come from the deployment distribution as they are, with replacement. Each is rolled
out with a probability that is known before, its chance. With a prediction of its failure that is fitted on the past
only, mean prediction + rolled out / chance * (failed - prediction) has the mean p, whatever the prediction: augmented
inverse probability weighting (Robins, Rotnitzky, Zhao 1994 <https://doi.org/10.1080/01621459.1994.10476818>). So the
sum of these values minus p is a martingale, also where predictions and chances follow from earlier outcomes, and its
variance is told by its steps (Luedtke, van der Laan 2016 <https://doi.org/10.1214/15-AOS1384>).
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.common.statistics import sequential_interval, wilson
from vlafuzz.common.text import interval, percent

# Chosen by simulation with seeds that scripts/simulate_probability.py does not report.
_LEAST = 0.25  # chance of a rollout
_FEW = 1.0  # failures beyond the prediction that are added to those observed, for the variance of few
_INSIDE, _ELSEWHERE, _WORTH = 0.8, 0.2, 2.0  # prior of failure rates, and how many draws it is worth
_TAIL = 0.025


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A random scene. All but ``failed`` must not depend on its outcome.

    Args:
        scene: what tells it from others; a scene that is drawn again may have its first outcome.
        chance: probability of a rollout, in (0, 1].
        failed: None where it is not rolled out.
        prediction: of the failure in this scene, in [0, 1].
        mean_prediction: over random scenes; ``error`` is its standard error.
    """

    scene: Hashable
    chance: float = 1.0
    failed: bool | None = None
    prediction: float = 0.0
    mean_prediction: float = 0.0
    error: float = 0.0

    def __post_init__(self) -> None:
        for name in ("chance", "prediction", "mean_prediction"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected 0 to 1, got {getattr(self, name)}")
        if not self.chance:
            raise ValueError("chance: expected more than 0")

    @property
    def value(self) -> float:
        """Its mean is the probability of failure."""
        if self.failed is None:
            return self.mean_prediction
        return self.mean_prediction + (self.failed - self.prediction) / self.chance


class Probability(NamedTuple):
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{percent(self.value)} ({interval(self.low, self.high)})"


def failure_probability(draws: Sequence[Draw], *, over: bool) -> Probability:
    """Estimate and 95 % interval, [0, 1] without draws.

    The interval is Wilson's of as many plain rollouts as would have the same variance. Draws of one scene count as one
    cluster, as they may share an outcome.

    Args:
        over: the number of rollouts was fixed in advance, and is reached. Else the interval holds at all times at once.
    """
    number = len(draws)
    if not number:
        return Probability(0.5, 0.0, 1.0)
    value = min(max(math.fsum(draw.value for draw in draws) / number, 0.0), 1.0)
    offs: defaultdict[Hashable, float] = defaultdict(float)
    for draw in draws:
        offs[draw.scene] += draw.value - value
    alike = sum(count**2 for count in Counter(draw.scene for draw in draws).values()) / number
    heavy = max(sum(draw.chance**-2 for draw in draws if draw.failed is not None) / number, 1.0)
    binomial = number * value * (1 - value) + _FEW
    ratio = (math.fsum(off**2 for off in offs.values()) / alike + _FEW * heavy) / binomial
    error = math.fsum(draw.error for draw in draws) / number
    worth = 1 / (alike * ratio / number + error**2 * number / binomial)
    low, high = wilson(value * worth, worth) if over else sequential_interval(value * worth, worth, _TAIL)
    return Probability(value, min(low, value), max(high, value))


def shared_out(inside: Mask) -> Array:
    """``(n, rules)`` parts of scenes: a scene in the ranges of several rules is shared out."""
    return np.asarray(inside / np.maximum(inside.sum(axis=1, keepdims=True), 1))


def share_of_range(parts: Array, weights: Array, failed: Mask) -> Probability:
    """The share of random scenes that are in a range and fail: the probability of the range times the rate in it.

    The interval of the product is that of Zou and Donner 2008 <https://doi.org/10.1002/sim.3095>.

    Args:
        parts: ``(n,)`` of random scenes, how much of each is in the range.
        weights: ``(m,)`` of those that were rolled out, the same, over the chance of their rollout.
        failed: ``(m,)`` whether they failed.
    """
    range_, number = float(parts.mean()), len(parts)
    total = float(weights.sum())
    rate = float((weights @ failed + _INSIDE * _WORTH) / (total + _WORTH))
    rolled = total**2 / float((weights**2).sum()) if total else 0.0
    of_range = wilson(range_ * number, number)
    of_rate = wilson(float(weights @ failed) / total * rolled if total else 0.0, rolled)
    low, high = (
        math.hypot(range_ * (rate - at), rate * (range_ - part)) for at, part in zip(of_rate, of_range, strict=True)
    )
    value = range_ * rate
    return Probability(value, max(0.0, value - low), min(1.0, value + high))


class Rates:
    """Failure rates of earlier draws where a known cause explains a failure, and elsewhere."""

    def __init__(self) -> None:
        self._failures = [_WORTH * _ELSEWHERE, _WORTH * _INSIDE]
        self._draws = [_WORTH, _WORTH]

    def learn(self, *, explained: bool, failed: bool) -> None:
        self._failures[explained] += failed
        self._draws[explained] += 1

    def predict(self, explained: float) -> float:
        """The probability of a failure in a scene, or in scenes of which that share is explained."""
        elsewhere, inside = (k / n for k, n in zip(self._failures, self._draws, strict=True))
        return elsewhere + (inside - elsewhere) * explained

    def chance(self, *, explained: bool) -> float:
        """The probability with which to roll out: less where outcomes vary less (Neyman 1934 <https://doi.org/10.2307/2342192>)."""
        if not explained:
            return 1.0
        inside, elsewhere = (math.sqrt(rate * (1 - rate)) for rate in (self.predict(1.0), self.predict(0.0)))
        return max(_LEAST, min(inside / elsewhere, 1.0))
