"""The probability that a policy fails in a random scene, from a guided search.

It rests on those scenes of the search that are drawn from the deployment distribution as they are: the mean of their
outcomes is the failure probability p. A prediction g of the outcome with a known mean G lowers the variance: failed - c
g + c G has the mean p for every c that is fixed before the draw.

For each possible p, two bettors start with a capital of 1: one bets that draws are lower on average, one that they are
higher. If p is the truth, a capital ever reaches 1 / a with a probability of at most a (Ville 1939), whatever the bets,
and whenever the search stops. The interval holds every p against which neither has reached its aim (Waudby-Smith,
Ramdas 2024 <https://doi.org/10.1093/jrsssb/qkad009>). They bet so that by the end of the budget they have reached it or
lost nearly all, which makes the interval about as narrow there as an exact one of a fixed number of draws (Voráček,
Orabona 2025 <https://arxiv.org/abs/2505.22422>).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_P = np.sin(np.linspace(0, np.pi / 2, 401)) ** 2  # as close together as intervals are narrow
_SIDE = np.array([[1.0], [-1.0]])  # the first row bets that p is lower, the second that it is higher
_ALPHA = 0.05
# Chosen by simulation with seeds that scripts/simulate_probability.py does not report.
_MEMORY = 0.99  # a draw's influence on the bets after one more draw
_OVERSHOOT = 0.1  # bets aim at slightly more than needed, as capital only approaches what they aim at
_ALL = 0.999  # largest part of the capital in one bet
_FEW = 4.0  # predicted failures in the whole search, up to which those observed say more


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A random scene and its outcome. All but ``failed`` must not depend on the outcome.

    Args:
        left: rollouts left in the budget for draws and for tests of causes, this draw included. prediction: of the
        failure in this scene, in [0, 1].
        mean_prediction: over random scenes.
    """

    failed: bool
    left: int
    prediction: float = 0.0
    mean_prediction: float = 0.0

    def __post_init__(self) -> None:
        for name, least, most in (("left", 1, math.inf), ("prediction", 0, 1), ("mean_prediction", 0, 1)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name}: expected {least:g} to {most:g}, got {getattr(self, name)}")


class Probability(NamedTuple):
    """An estimate, and the interval that holds at all times at once with the given confidence."""

    value: float
    low: float
    high: float


def failure_probability(draws: Iterable[Draw]) -> Probability:
    """Estimate and 95% interval, in the order in which the draws were proposed.

    More draws only shrink the interval. It is narrowest at the end of the budget, [0, 1] without draws.
    """
    known = list(draws)
    if not known:
        return Probability(0.5, 0.0, 1.0)
    bettors = _Bettors(known[0].left)
    for draw in known:
        bettors.bet(draw)
    return bettors.summary()


class _Past:
    """Earlier draws: failures beyond the prediction and failures missing from it, with their sizes."""

    def __init__(self) -> None:
        self.draws = 0.0
        self.over = self.under = np.array([0.5, 0.5])  # sums of sizes and of their squares; one to start with
        self.predicted = self.confirmed = 2.0

    def trust(self) -> float:
        """Share of predicted failures that happened."""
        return min(self.confirmed / self.predicted, 1.0)

    def add(self, draw: Draw, trust: float) -> None:
        residual = draw.failed - trust * draw.prediction
        sizes = np.array([abs(residual), residual**2])
        self.draws = _MEMORY * self.draws + 1
        self.over = _MEMORY * self.over + sizes * (residual > 0)
        self.under = _MEMORY * self.under + sizes * (residual < 0)
        self.predicted += draw.prediction**2
        self.confirmed += draw.prediction * draw.failed

    def moments(self, mean: Array) -> tuple[Array, Array]:
        """Variance of a draw and size of its jumps (third moment / variance), if p is each of ``_P``."""
        missing = np.minimum(self.under[0] / (self.draws + 1), 1.0) * mean / max(mean.max(), 1e-9)
        shift = _P - mean
        up = np.maximum(np.minimum(missing, mean) + shift, 1e-6)  # mean of the failures beyond the prediction
        down = up - shift
        over = np.maximum(self.over[1] / self.over[0], up)
        under = np.maximum(self.under[1] / self.under[0], down)
        square = over * up + under * down
        variance = np.maximum(square - shift**2, 0.003 * shift**2 + 1e-9)
        third = over**2 * up - under**2 * down - 3 * shift * square + 2 * shift**3
        return variance, third / variance


class _Bettors:
    def __init__(self, budget: int) -> None:
        # Near 0 the width is mostly that above p, so that nearly all of the error is allowed there.
        low_end, high_end = np.exp(-_P * budget / 8), np.exp(-(1 - _P) * budget / 8)
        upper = 0.5 + 0.4 * (low_end - high_end)
        self._aim = -np.log(_ALPHA * np.stack([upper, 1 - upper]))
        self._capital = np.zeros((2, len(_P)))  # logarithms
        self._peak = np.zeros((2, len(_P)))
        self._past, self._count, self._spent = _Past(), 0, 0
        self._budget = self._left = budget
        self._sum = 0.0

    def bet(self, draw: Draw) -> None:
        self._spent += max(self._left - draw.left, 0)
        self._left = draw.left
        coming = max(1.0, draw.left * (self._count + 10) / (self._spent + 10))
        trust = self._past.trust() if draw.mean_prediction else 0.0
        # A wrong prediction costs the second bettor up to 1, whatever p is.
        enough = (self._count + coming) * draw.mean_prediction / _FEW - 1
        trusts = trust * np.array([[1.0], [min(max(enough, 0.0), 1.0)]])
        mean = trusts * draw.mean_prediction
        value = draw.failed - trusts * draw.prediction + mean
        variance, jump = self._past.moments(mean)
        jump = np.clip(jump, -1, 1) * _SIDE
        # Where many scenes fail, later draws vary less, as causes become known: bet less in the beginning.
        slack = 1 + np.minimum(4 * np.minimum(_P, 1 - _P), 1) * min(draw.left / self._budget, 1)
        stake = _stake(self._capital - self._aim - _OVERSHOOT, variance, jump, coming * slack)
        worst = np.where(_SIDE > 0, 1 + mean - _P, _P - mean + trusts)
        stake = np.where(self._peak < self._aim, np.minimum(stake, _ALL / np.maximum(worst, 1e-3)), 0.0)
        self._capital += np.log1p(stake * _SIDE * (_P - value))
        self._peak = np.maximum(self._peak, self._capital)
        self._count += 1
        self._past.add(draw, trust)
        self._sum += float(value[0, 0])

    def summary(self) -> Probability:
        surplus = self._peak - self._aim
        high = _crossing(_P[::-1], surplus[0, ::-1])
        low = min(_crossing(_P, surplus[1]), high)
        return Probability(float(np.clip(self._sum / self._count, low, high)), low, high)


def _stake(odds: Array, variance: Array, jump: Array, coming: Array) -> Array:
    """Bets that bring capital to its aim with the largest probability in the draws to come.

    This probability cannot exceed ``exp(odds)``, capital over aim. The sum of the draws is taken as a number of jumps
    with Poisson's distribution, whose square root is about normal with variance 1/4; as jumps get small this becomes
    the normal distribution. The bet is what one jump changes in the probability.

    Args:
        jump: positive where it goes against the bettor.
    """
    from scipy.special import log_ndtr, ndtri_exp

    sign = np.where(jump > 0, 1.0, -1.0)
    size = np.maximum(np.abs(jump), 0.1 * np.sqrt(variance))
    expected = np.sqrt(variance * coming) / size
    score = ndtri_exp(np.minimum(odds, -1e-9))
    jumps = np.maximum(expected + sign * score / 2, 0) ** 2  # the most that the bettor can bear, or needs
    after = 2 * sign * (np.sqrt(np.maximum(jumps - 1, 0)) - expected)
    last = np.where(sign > 0, -np.inf, 0.0)
    before = log_ndtr(2 * sign * (np.sqrt(jumps) - expected))
    change = np.where(jumps < 1.5, last, log_ndtr(after)) - before
    return np.asarray(sign * (1 - np.exp(np.minimum(change, 50.0))) / size)


def _crossing(values: Array, surplus: Array) -> float:
    """Where surplus is negative for the first time, interpolated; the last value if it never is."""
    first = int(np.argmax(surplus < 0)) if (surplus < 0).any() else len(values) - 1
    if first == 0:
        return float(values[0])
    inner, outer = surplus[first], surplus[first - 1]
    part = min(1.0, -inner / (outer - inner)) if inner < 0 else 0.0
    return float(values[first] + (values[first - 1] - values[first]) * part)
