"""Intervals of shares and ratios, and tests of whether two samples differ."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from statistics import NormalDist
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.text import interval, percent

Counts = NDArray[np.integer] | int
_STAKE = 0.7  # share of the wealth that is on a rate near 1
_TINY = 1e-9
_TAIL = 0.975  # of intervals of 95 %
_Z = NormalDist().inv_cdf(_TAIL)


class Interval(NamedTuple):
    """Both ends included."""

    low: float
    high: float


@dataclass(frozen=True)
class Share:
    """``count`` of ``of`` cases, and the 95% confidence interval of their share, ``low`` to ``high``."""

    count: int
    of: int
    low: float
    high: float

    @classmethod
    def of_counts(cls, count: int, of: int) -> Self:
        """Make the share of independent cases, with Wilson's interval."""
        return cls(count, of, *wilson(count, of))

    @property
    def share(self) -> float:
        """The share in [0, 1]; 0 where there are no cases."""
        return self.count / self.of if self.of else 0.0

    def __str__(self) -> str:
        return f"{percent(self.share)} ({interval(self.low, self.high)})" if self.of else "–"


def wilson(k: float, n: float) -> Interval:
    """Wilson's 95 % score interval of a share, ``k`` of ``n``; [0, 1] when n is 0.

    SciPy's takes integers only, and there are effective counts.
    """
    if n == 0:
        return Interval(0.0, 1.0)
    centre = (k + _Z**2 / 2) / (n + _Z**2)
    half = _Z * math.sqrt(k * (n - k) / n + _Z**2 / 4) / (n + _Z**2)
    return Interval(0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def sequential_interval(k: float, n: float, alpha: float = 0.05) -> Interval:
    """Lower and upper bound of a rate, each of confidence 1 - alpha, wherever a sequential test stopped.

    The lower one is the smallest rate that a mixture of bets on larger rates does not refute, by Ville's inequality:
    Robbins 1970 <https://doi.org/10.1214/aoms/1177696786>, <https://doi.org/10.1214/23-STS894>.
    """
    if not 0 <= k <= n:
        raise ValueError(f"{k} of {n} cases")
    return Interval(_sequential_low(k, n, alpha), 1.0 - _sequential_low(n - k, n, alpha))


@cache
def _sequential_low(k: float, n: float, alpha: float) -> float:
    from scipy.optimize import brentq

    if k == 0:
        return 0.0

    def surplus(p0: float) -> float:
        return _log_wealth(p0, k, n) + math.log(alpha)

    return 0.0 if surplus(_TINY) < 0 else float(brentq(surplus, _TINY, k / n - _TINY * (k == n)))


def _log_wealth(p0: float, k: float, n: float) -> float:
    """Logarithm of the wealth of betting against "the rate is at most p0" after k of n.

    Most of it is on a rate near 1, so that few outcomes suffice where all agree; the rest is spread evenly.
    """
    from scipy.special import betaincc, betaln

    null = k * math.log(p0) + (n - k) * math.log1p(-p0)
    nearly = 1 - (1 - p0) / 10
    peak = k * math.log(nearly) + (n - k) * math.log1p(-nearly) - null
    with np.errstate(divide="ignore"):  # nothing is left where p0 is far above k / n
        spread = betaln(k + 1, n - k + 1) + np.log(betaincc(k + 1, n - k + 1, p0)) - math.log1p(-p0) - null
    return float(np.logaddexp(math.log(_STAKE) + peak, math.log(1 - _STAKE) + spread))


def newcombe(k: int, n: int, other_k: int, other_n: int) -> Interval:
    """95 % interval of ``k / n - other_k / other_n``: Newcombe 1998, method 10, which SciPy does not have.

    <https://doi.org/10.1002/(SICI)1097-0258(19980430)17:8%3C873::AID-SIM779%3E3.0.CO;2-I>
    """
    share, other = k / n, other_k / other_n
    mine, others = wilson(k, n), wilson(other_k, other_n)
    return Interval(
        share - other - math.hypot(share - mine.low, others.high - other),
        share - other + math.hypot(mine.high - share, other - others.low),
    )


@dataclass(frozen=True)
class SignedRank:
    """Wilcoxon's signed-rank test of paired values; in ``more`` pairs ours is larger, in ``fewer`` smaller.

    ``effect`` is the rank-biserial correlation, in [-1, 1]; ``p`` is two-sided.
    """

    more: int
    fewer: int
    effect: float
    p: float


def signed_rank(ours: Sequence[float], theirs: Sequence[float]) -> SignedRank:
    """Test whether paired values differ; equal ones take the lowest ranks and count for neither (Pratt 1959).

    It is exact; SciPy's ``wilcoxon`` is so with ties up to 13 pairs only, and does not say which way they differ.
    """
    from scipy.stats import rankdata

    # Two runs without a figure are equal, although infinity minus infinity is no number.
    differences = np.array([a - b if a != b else 0.0 for a, b in zip(ours, theirs, strict=True)])
    ranks = np.rint(2 * rankdata(np.abs(differences))).astype(int)  # doubled: those of ties end in a half
    chances = np.ones(1)  # of the sums of ranks that are positive
    for rank in ranks[differences != 0]:
        chances = (np.pad(chances, (0, rank)) + np.pad(chances, (rank, 0))) / 2
    won, lost = (int(ranks[chosen].sum()) for chosen in (differences > 0, differences < 0))
    return SignedRank(
        more=int((differences > 0).sum()),
        fewer=int((differences < 0).sum()),
        effect=(won - lost) / max(won + lost, 1),
        p=min(1.0, 2 * float(chances[: min(won, lost) + 1].sum())),
    )


def smallest_p(pairs: int) -> float:
    """The smallest p-value of ``signed_rank`` for so many pairs: ours is larger in all of them."""
    return min(1.0, 2.0 ** (1 - pairs))


def pairs_needed(tests: int, alpha: float) -> int:
    """Pairs for the smallest possible p-value to pass Holm's correction for so many tests."""
    return next(pairs for pairs in count(2) if tests * smallest_p(pairs) <= alpha)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for multiple testing: Holm 1979 <https://www.jstor.org/stable/4615733>."""
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted


@dataclass(frozen=True)
class Estimate:
    """An estimate and its 95 % confidence interval; without bounds where the runs give none."""

    value: float
    low: float | None = None
    high: float | None = None

    def __str__(self) -> str:
        bounds = "no bound" if self.low is None else f"{self.low:.3g} to {self.high:.3g}"
        return f"{self.value:.3g} ({bounds})"


def mean_ratio(ours: Sequence[float], theirs: Sequence[float]) -> Estimate | None:
    """Ratio of the means of paired values, none of them negative; None if it is not finite.

    The interval is Student's for the jackknifed logarithm: Miller 1974 <https://doi.org/10.1093/biomet/61.1.1>. It has
    no bounds where all pairs have the same ratio, or where one pair decides.
    """
    mine, other = np.asarray(ours, float), np.asarray(theirs, float)
    if not (np.isfinite([mine, other]).all() and other.sum() > 0):
        return None
    value = float(mine.sum() / other.sum())
    without = np.stack([mine.sum() - mine, other.sum() - other])  # the sums without one of the pairs
    ratios = without[0] / without[1] if (without > 0).all() else np.zeros(1)
    if np.ptp(ratios) <= _TINY * value:
        return Estimate(value)
    from scipy.stats import t

    logs = np.log(ratios)
    half = float(t.ppf(_TAIL, len(logs) - 1) * logs.std(ddof=1) / math.sqrt(len(logs)))
    factor = math.exp((len(logs) - 1) * half)
    return Estimate(value, value / factor, value * factor)


def mean_estimate(values: Sequence[float]) -> Estimate | None:
    """Mean of values, none of them negative, with the interval of ``mean_ratio``."""
    return mean_ratio(values, [1.0] * len(values))


def sign_p(worse: Counts, better: Counts) -> NDArray[np.float64]:
    """One-sided p-value of the exact sign test: that so many pairs or more are worse by chance."""
    from scipy.special import betainc

    return np.where(np.asarray(worse) > 0, betainc(np.maximum(worse, 1), better + 1, 0.5), 1.0)
