"""A one-sided sign test that may be looked at after every pair: whether a subject is worse.

Of two subjects in the same scene only a discordant pair tells them apart, one passing where the other fails
(McNemar 1947, <https://doi.org/10.1007/BF02295996>). Where the two are alike, either is the worse one with
probability 1/2, whatever the scene and whatever came before; so a bet on "the new one is worse, with
probability p" multiplies a gambler's money by ``2p`` or ``2(1 - p)``, and does not win on average. Neither
does a mixture of such bets over p (Robbins 1970, <https://doi.org/10.1214/aoms/1177696786>). By Ville's
inequality (1939) the money of who cannot win on average ever reaches ``1 / alpha`` with probability ``alpha``
at most. So the test can be ended at any moment, by an alarm or for want of hope, and false alarms stay below
``alpha`` over the whole of it (Ramdas et al. 2023, <https://doi.org/10.1214/23-STS894>).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import count
from math import comb

# Most of the money is on "nearly always the new one", as a broken subject is: five pairs of five then make
# an alarm at 5 %, and no test can do with fewer (1/2 to the fifth is 3 %). The rest is spread evenly over p.
_NEARLY_ALWAYS, _STAKE = 0.95, 0.7


@cache
def money(worse: int, better: int) -> float:
    """Of a gambler who began with 1 and bet that the new subject is worse, after these discordant pairs."""
    pairs = worse + better
    nearly = (2 * _NEARLY_ALWAYS) ** worse * (2 - 2 * _NEARLY_ALWAYS) ** better
    # The mean of (2p)^worse (2 - 2p)^better over p in [1/2, 1]: an incomplete beta integral, in closed form.
    spread = sum(comb(pairs + 1, each) for each in range(worse + 1)) / ((pairs + 1) * comb(pairs, worse))
    return _STAKE * nearly + (1 - _STAKE) * spread


def needed(alpha: float, better: int = 0) -> int:
    """The fewest pairs that have to be worse for an alarm, where ``better`` are better."""
    return next(worse for worse in count() if money(worse, better) >= 1 / alpha)


@dataclass
class SignTest:
    """The test as it goes on.

    Attributes:
        worse: discordant pairs in which only the new subject failed; ``better``: in which only it passed.
    """

    alpha: float
    worse: int = 0
    better: int = 0
    _most: float = 1.0

    def see(self, *, worse: bool) -> None:
        """One more discordant pair."""
        self.worse += worse
        self.better += not worse
        self._most = max(self._most, money(self.worse, self.better))

    @property
    def p_value(self) -> float:
        """Valid whenever it is looked at (Johari et al. 2022, <https://doi.org/10.1287/opre.2021.2135>)."""
        return 1 / self._most

    @property
    def alarm(self) -> bool:
        """Whether the new subject is worse, at ``alpha``."""
        return self.p_value <= self.alpha

    def hopeless(self, left: int) -> bool:
        """Whether no alarm can come of this many more pairs: not even if all of them are worse."""
        return not self.alarm and money(self.worse + left, self.better) < 1 / self.alpha
