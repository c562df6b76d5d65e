"""Whether two strategies differ, by how much, and how sure that is. Nothing here knows what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scoring import Interval

_EXACT = 20_000  # ways to deal two samples out, up to which all of them are counted
_RESAMPLES = 10_000


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


def _ranked(values: Sequence[float]) -> NDArray[np.float64]:
    """As floats; the infinite ones as numbers, of which a difference can be taken."""
    return np.nan_to_num(np.asarray(values, dtype=np.float64), posinf=1e300, neginf=-1e300)
