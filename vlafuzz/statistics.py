"""Intervals of shares and ratios, and tests of whether two samples differ."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from statistics import NormalDist
from typing import NamedTuple, Self

import numpy as np

from vlafuzz.text import interval, percent

_EXACT = 20_000  # permutations of two samples, up to which all are counted
_RESAMPLES = 10_000
_STAKE = 0.7  # share of the wealth that is on a rate near 1
_TINY = 1e-9


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
        """Of independent cases: Wilson's interval."""
        return cls(count, of, *wilson(count, of))

    @classmethod
    def grouped(cls, cases: Sequence[tuple[int, bool]]) -> Self:
        """Of cases with their group; those of one group may be alike, see ``share_interval``."""
        return cls(sum(positive for _, positive in cases), len(cases), *share_interval(cases))

    @property
    def share(self) -> float:
        """In [0, 1]; 0 where there are no cases."""
        return self.count / self.of if self.of else 0.0

    def __str__(self) -> str:
        return f"{percent(self.share)} ({interval(self.low, self.high)})" if self.of else "–"


def wilson(k: float, n: float, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a share, ``k`` of ``n``; [0, 1] when n is 0.

    SciPy's takes integers only, ``share_interval`` needs effective counts.
    """
    if n == 0:
        return Interval(0.0, 1.0)
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    centre = (k + z**2 / 2) / (n + z**2)
    half = z * math.sqrt(k * (n - k) / n + z**2 / 4) / (n + z**2)
    return Interval(0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def sequential_interval(k: int, n: int, alpha: float = 0.05) -> Interval:
    """Lower and upper bound of a rate, each with confidence 1 - alpha, wherever a sequential test stopped.

    The lower bound is the smallest rate p0 that a bet against "at most p0" does not refute: the wealth of a
    mixture of bets on larger rates stays below 1 / alpha with probability 1 - alpha by Ville's inequality
    (Robbins 1970, <https://doi.org/10.1214/aoms/1177696786>; Ramdas et al. 2023,
    <https://doi.org/10.1214/23-STS894>). Five of five put it above one half.
    """
    return Interval(_sequential_low(k, n, alpha), 1.0 - _sequential_low(n - k, n, alpha))


@cache
def _sequential_low(k: int, n: int, alpha: float) -> float:
    from scipy.optimize import brentq

    if k == 0:
        return 0.0

    def surplus(p0: float) -> float:
        return _log_wealth(p0, k, n) + math.log(alpha)

    return 0.0 if surplus(_TINY) < 0 else float(brentq(surplus, _TINY, k / n - _TINY * (k == n)))


def _log_wealth(p0: float, k: int, n: int) -> float:
    """Logarithm of the wealth of betting against "the rate is at most p0" after k of n.

    Most of the wealth is on a rate near 1, so that few outcomes suffice where all agree; the rest is spread
    evenly over [p0, 1].
    """
    from scipy.special import betaln
    from scipy.stats import beta

    null = k * math.log(p0) + (n - k) * math.log1p(-p0)
    nearly = 1 - (1 - p0) / 10
    peak = k * math.log(nearly) + (n - k) * math.log1p(-nearly) - null
    spread = betaln(k + 1, n - k + 1) + beta.logsf(p0, k + 1, n - k + 1) - math.log1p(-p0) - null
    return float(np.logaddexp(math.log(_STAKE) + peak, math.log(1 - _STAKE) + spread))


def newcombe(k: int, n: int, other_k: int, other_n: int) -> Interval:
    """95 % interval of ``k / n - other_k / other_n``, from the two shares' own intervals.

    Newcombe 1998, method 10 <https://doi.org/10.1002/(SICI)1097-0258(19980430)17:8%3C873::AID-SIM779%3E3.0.CO;2-I>;
    SciPy does not have it.
    """
    share, other = k / n, other_k / other_n
    mine, others = wilson(k, n), wilson(other_k, other_n)
    return Interval(
        share - other - math.hypot(share - mine.low, others.high - other),
        share - other + math.hypot(mine.high - share, other - others.low),
    )


def a12(ours: Sequence[float], theirs: Sequence[float]) -> float:
    """Probability that a value of ours is larger than one of theirs; a tie counts half.

    Vargha, Delaney 2000 <https://doi.org/10.3102/10769986025002101>.
    """
    from scipy.stats import mannwhitneyu

    u = mannwhitneyu(ours, theirs, method="asymptotic").statistic
    return float(u) / (len(ours) * len(theirs))


def mann_whitney(ours: Sequence[float], theirs: Sequence[float]) -> float:
    """Two-sided p-value of Mann and Whitney's U test.

    For small samples all permutations are counted, so that it is exact even with ties.
    """
    from scipy.stats import PermutationMethod, mannwhitneyu

    if len({*ours, *theirs}) == 1 or min(len(ours), len(theirs)) < 2:
        return 1.0
    few = math.comb(len(ours) + len(theirs), len(ours)) <= _EXACT
    method = PermutationMethod(n_resamples=_EXACT) if few else "asymptotic"
    return min(1.0, float(mannwhitneyu(ours, theirs, alternative="two-sided", method=method).pvalue))


def smallest_p(ours: int, theirs: int) -> float:
    """The smallest p-value that samples of these sizes can have: all values of one above all of the other."""
    return min(1.0, 2.0 / math.comb(ours + theirs, ours))


def repeats_needed(tests: int, alpha: float) -> int:
    """Repeats per sample for the smallest possible p-value to pass Holm's correction for so many tests."""
    return next(repeats for repeats in count(2) if tests * smallest_p(repeats, repeats) <= alpha)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for multiple testing: Holm 1979 <https://www.jstor.org/stable/4615733>."""
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> float | None:
    """Ratio of the means; None if theirs is 0 or one of them is not finite."""
    mine, other = float(np.mean(ours)), float(np.mean(theirs))
    return mine / other if other > 0 and math.isfinite(mine) and math.isfinite(other) else None


def ratio_interval(
    ours: Sequence[float], theirs: Sequence[float], seed: int = 0, confidence: float = 0.95
) -> Interval | None:
    """Percentile bootstrap interval of ``ratio``; the n-th values of ours and theirs are drawn as a pair.

    Efron 1979 <https://doi.org/10.1214/aos/1176344552>. Of means, as medians of few repeats jump, and are 0
    for rare failures. None if it has no bound: with fewer than two pairs, or where theirs may well be 0.
    """
    if len(ours) < 2 or ratio(ours, theirs) is None:
        return None
    drawn = np.random.default_rng(seed).integers(len(ours), size=(_RESAMPLES, len(ours)))
    mine, other = np.asarray(ours)[drawn].mean(axis=1), np.asarray(theirs)[drawn].mean(axis=1)
    # 0 / 0 is left out; x / 0 is infinite, and ranks above all finite ratios.
    ratios = np.divide(mine, other, out=np.full(len(mine), np.inf), where=other > 0)[(mine > 0) | (other > 0)]
    tail = (1 - confidence) / 2
    low, high = np.quantile(ratios, [tail, 1 - tail], method="inverted_cdf")
    return Interval(float(low), float(high)) if math.isfinite(high) else None


def share_interval(cases: Sequence[tuple[int, bool]], confidence: float = 0.95) -> Interval:
    """Confidence interval of the share of positive cases that come from several runs.

    Cases of one run resemble each other, so they carry less information than as many independent ones. This
    is Wilson's interval for the effective number of cases: the number of independent cases that would vary
    as the runs do, reduced further when there are few runs (Korn, Graubard 1998; Franco, Little, Louis, Slud
    2019 <https://pmc.ncbi.nlm.nih.gov/articles/PMC6690503>). A bootstrap over 3 or 5 runs is too narrow.
    With one run, or where all or no cases are positive, the runs show no variation: it is then Wilson's
    interval of all cases, which may be too narrow.

    Args:
        cases: the run of each case, and whether the case is positive.
    """
    number, hits = len(cases), sum(positive for _, positive in cases)
    runs = [[positive for of, positive in cases if of == run] for run in {of for of, _ in cases}]
    if len(runs) < 2 or hits in (0, number):
        return wilson(hits, number, confidence)
    from scipy.stats import norm, t

    share, tail = hits / number, (1 + confidence) / 2
    # The variance of a ratio of totals, by linearisation.
    squares = sum((sum(run) - share * len(run)) ** 2 for run in runs)
    variance = squares / number**2 * len(runs) / (len(runs) - 1)
    few = float(norm.ppf(tail) / t.ppf(tail, len(runs) - 1)) ** 2
    effective = min(number, few * share * (1 - share) / variance) if variance else number
    return wilson(share * effective, effective, confidence)
