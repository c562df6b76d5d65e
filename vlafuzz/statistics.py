"""Intervals of shares and ratios, and tests of whether two samples differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_EXACT = 20_000  # ways to deal two samples out, up to which all of them are counted
_RESAMPLES = 10_000


class Interval(NamedTuple):
    """Both ends included."""

    low: float
    high: float


def wilson(k: float, n: float, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a share, ``k`` of ``n``; all of [0, 1] when n is 0."""
    if n == 0:
        return Interval(0.0, 1.0)
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    centre = (k + z**2 / 2) / (n + z**2)
    half = z * math.sqrt(k * (n - k) / n + z**2 / 4) / (n + z**2)
    return Interval(0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def newcombe(k: int, n: int, other_k: int, other_n: int) -> Interval:
    """95 % interval of ``k / n - other_k / other_n``, from the two shares' own intervals.

    Newcombe 1998, method 10 <https://doi.org/10.1002/(SICI)1097-0258(19980430)17:8%3C873::AID-SIM779%3E3.0.CO;2-I>:
    SciPy has Wilson's interval, not this one.
    """
    share, other = k / n, other_k / other_n
    mine, others = wilson(k, n), wilson(other_k, other_n)
    return Interval(
        share - other - math.hypot(share - mine.low, others.high - other),
        share - other + math.hypot(mine.high - share, other - others.low),
    )


def a12(ours: Sequence[float], theirs: Sequence[float]) -> float:
    """How often one of ours is larger than one of theirs; a tie counts half.

    Vargha, Delaney 2000 <https://doi.org/10.3102/10769986025002101>.
    """
    return float(np.mean((np.sign(np.subtract.outer(_ranked(ours), _ranked(theirs))) + 1) / 2))


def mann_whitney(ours: Sequence[float], theirs: Sequence[float]) -> float:
    """Two-sided p-value of Mann and Whitney's U test.

    Of small samples all ways to deal them out are counted, so that it is exact with ties as well.
    """
    from scipy.stats import PermutationMethod, mannwhitneyu

    if len({*ours, *theirs}) == 1 or min(len(ours), len(theirs)) < 2:
        return 1.0
    few = math.comb(len(ours) + len(theirs), len(ours)) <= _EXACT
    method = PermutationMethod(n_resamples=_EXACT) if few else "asymptotic"
    found = mannwhitneyu(_ranked(ours), _ranked(theirs), alternative="two-sided", method=method)
    return min(1.0, float(found.pvalue))


def smallest_p(ours: int, theirs: int) -> float:
    """The least p-value that samples of these sizes can have: when all of one are above all of the other."""
    return min(1.0, 2.0 / math.comb(ours + theirs, ours))


def repeats_needed(tests: int, alpha: float) -> int:
    """Of both samples, so that the least p-value passes after Holm's correction for so many tests."""
    repeats = 2
    while tests * smallest_p(repeats, repeats) > alpha:
        repeats += 1
    return repeats


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for how many there are: Holm 1979 <https://www.jstor.org/stable/4615733>."""
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> float | None:
    """Of the means; None where theirs is 0, or one of them is not finite."""
    mine, other = float(np.mean(ours)), float(np.mean(theirs))
    return mine / other if other > 0 and math.isfinite(mine) and math.isfinite(other) else None


def ratio_interval(
    ours: Sequence[float], theirs: Sequence[float], seed: int = 0, confidence: float = 0.95
) -> Interval | None:
    """Percentile bootstrap interval of ``ratio``; the n-th of ours and of theirs are drawn together.

    Efron 1979 <https://doi.org/10.1214/aos/1176344552>. Of means, as medians of few repeats jump, and are 0
    for rare failures. None where it has no bound: with less than two pairs, or where theirs may well be 0.
    """
    if len(ours) < 2 or ratio(ours, theirs) is None:
        return None
    drawn = np.random.default_rng(seed).integers(len(ours), size=(_RESAMPLES, len(ours)))
    mine, other = np.asarray(ours)[drawn].mean(axis=1), np.asarray(theirs)[drawn].mean(axis=1)
    # Nothing in both says nothing; ours alone is infinitely more, and has its place in the order.
    ratios = np.divide(mine, other, out=np.full(len(mine), np.inf), where=other > 0)[(mine > 0) | (other > 0)]
    tail = (1 - confidence) / 2
    low, high = np.quantile(ratios, [tail, 1 - tail], method="inverted_cdf")
    return Interval(float(low), float(high)) if math.isfinite(high) else None


def share_interval(cases: Sequence[tuple[int, bool]], confidence: float = 0.95) -> Interval:
    """Interval of the share of cases that are so, where they come from several runs.

    Cases of one run resemble each other, so that they say less than as many independent ones. This is
    Wilson's interval of the effective number of cases: as many independent ones as would vary like the runs
    do, and fewer of them the fewer runs say how they vary (Korn, Graubard 1998; Franco, Little, Louis, Slud
    2019 <https://pmc.ncbi.nlm.nih.gov/articles/PMC6690503>). A bootstrap over 3 or 5 runs is too narrow.
    With one run, and where none or all of the cases are so, nothing varies: there it is Wilson's interval of
    all cases, which may then be too narrow.

    Args:
        cases: the run of each, and whether it is so.
    """
    number, found = len(cases), sum(so for _, so in cases)
    runs = [[so for of, so in cases if of == run] for run in {of for of, _ in cases}]
    if len(runs) < 2 or found in (0, number):
        return wilson(found, number, confidence)
    from scipy.stats import norm, t

    share, tail = found / number, (1 + confidence) / 2
    # The variance of a ratio of totals, by linearisation.
    squares = sum((sum(its) - share * len(its)) ** 2 for its in runs)
    variance = squares / number**2 * len(runs) / (len(runs) - 1)
    few = float(norm.ppf(tail) / t.ppf(tail, len(runs) - 1)) ** 2
    effective = min(number, few * share * (1 - share) / variance) if variance else number
    return wilson(share * effective, effective, confidence)


def _ranked(values: Sequence[float]) -> NDArray[np.float64]:
    """As floats; the infinite ones as numbers, of which a difference can be taken."""
    return np.nan_to_num(np.asarray(values, dtype=np.float64), posinf=1e300, neginf=-1e300)
