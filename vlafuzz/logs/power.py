"""The loss of success that so many episodes could notice."""

import math
from functools import cache

import numpy as np

from vlafuzz.common.statistics import binomial

POWER = 0.9
_MOST = 4000  # pairs that are computed: the effort grows with the square of their number
_STEPS = 10  # of bisection: to a tenth of a point
_RARE = 1e-6  # numbers of discordant pairs that are less probable are left out


def noticeable_loss(pairs: int, success: float, alpha: float) -> float | None:
    """The smallest loss that a sign test of so many pairs notices with 90 % power; None if none is.

    Outcomes count as independent of each other within a pair, as those of two policies that fail by chance
    are. Where the same episodes fail under both, fewer pairs disagree and a smaller loss is noticed.

    Args:
        success: rate of the old one. ``alpha``: of the two-sided test.
    """
    if not pairs or power(min(pairs, _MOST), success, success, alpha) < POWER:
        return None
    if pairs > _MOST:  # from there on it shrinks with the square root of their number, or faster
        most = noticeable_loss(_MOST, success, alpha)
        return most and most * math.sqrt(_MOST / pairs)
    low, high = 0.0, success
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if power(pairs, success, middle, alpha) >= POWER else (middle, high)
    return high


def power(pairs: int, success: float, loss: float, alpha: float) -> float:
    """The probability that a two-sided sign test shows that the new one is worse by ``loss``."""
    worse, better = success * (1 - success + loss), (1 - success) * (success - loss)
    chances = binomial(pairs, worse + better)
    return sum(
        float(chances[discordant] * binomial(int(discordant), worse / (worse + better))[fewest:].sum())
        for discordant in np.flatnonzero(chances > _RARE)
        if (fewest := _fewest(int(discordant), alpha)) <= discordant
    )


@cache
def _fewest(discordant: int, alpha: float) -> int:
    """How many of the discordant pairs must be worse to be shown; one more than all if none suffices."""
    tails = np.cumsum(binomial(discordant, 0.5)[::-1])
    return discordant + 1 - int(np.sum(2 * tails <= alpha))
