"""The loss of success that so many episodes could notice."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

POWER = 0.9
_STEPS = 10  # of bisection: to a tenth of a point
_RARE = 1e-6  # numbers of discordant pairs that are less probable are left out


def noticeable_loss(pairs: int, success: float, alpha: float) -> float | None:
    """The smallest loss that a sign test of so many pairs notices with 90 % power; None if none is.

    Outcomes count as independent of each other within a pair, as those of two policies that fail by chance
    are. Where the same episodes fail under both, fewer pairs disagree and a smaller loss is noticed.

    Args:
        success: rate of the old one. ``alpha``: of the two-sided test.
    """
    if not pairs or power(pairs, success, success, alpha) < POWER:
        return None
    low, high = 0.0, success
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if power(pairs, success, middle, alpha) >= POWER else (middle, high)
    return high


def power(pairs: int, success: float, loss: float, alpha: float) -> float:
    """The probability that a two-sided sign test shows that the new one is worse by ``loss``."""
    worse, better = success * (1 - success + loss), (1 - success) * (success - loss)
    chances = _binomial(pairs, worse + better)
    return sum(
        float(chances[discordant] * _binomial(int(discordant), worse / (worse + better))[fewest:].sum())
        for discordant in np.flatnonzero(chances > _RARE)
        if (fewest := _fewest(int(discordant), alpha)) <= discordant
    )


@cache
def _fewest(discordant: int, alpha: float) -> int:
    """How many of the discordant pairs must be worse to be shown; one more than all if none suffices."""
    tails = np.cumsum(_binomial(discordant, 0.5)[::-1])
    return discordant + 1 - int(np.sum(2 * tails <= alpha))


def _binomial(number: int, share: float) -> NDArray[np.float64]:
    """Probabilities of 0 to ``number`` cases."""
    if not 0 < share < 1:
        certain = np.zeros(number + 1)
        certain[number if share else 0] = 1.0
        return certain
    counts = np.arange(number + 1)
    factorials = _log_factorials(number.bit_length())[: number + 1]
    ways = factorials[number] - factorials - factorials[::-1]
    chances: NDArray[np.float64] = np.exp(ways + counts * np.log(share) + counts[::-1] * np.log1p(-share))
    return chances


@cache
def _log_factorials(bits: int) -> NDArray[np.float64]:
    """Of all numbers with so many bits."""
    return np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, 1 << bits)))])
