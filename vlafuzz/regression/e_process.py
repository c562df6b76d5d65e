"""A one-sided sign test that may be looked at after every pair: whether a policy is worse.

Of two policies in the same scene only a discordant pair tells them apart, one passing where the other fails
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

# Most of the money is on "nearly always the new one", as a broken policy is: five pairs of five then make
# an alarm at 5 %, and no test can do with fewer (1/2 to the fifth is 3 %). The rest is spread evenly over p.
_NEARLY_ALWAYS, _STAKE = 0.95, 0.7


@cache
def wealth(worse: int, better: int) -> float:
    """Of a gambler who began with 1 and bet that the new policy is worse, after these discordant pairs."""
    pairs = worse + better
    nearly = (2 * _NEARLY_ALWAYS) ** worse * (2 - 2 * _NEARLY_ALWAYS) ** better
    # The mean of (2p)^worse (2 - 2p)^better over p in [1/2, 1]: an incomplete beta integral, in closed form.
    spread = sum(comb(pairs + 1, each) for each in range(worse + 1)) / ((pairs + 1) * comb(pairs, worse))
    return _STAKE * nearly + (1 - _STAKE) * spread


@dataclass
class SignTest:
    """The test as it goes on.

    Half of the money is bet on all scenes, and half on the controls alone: a policy that breaks those is
    worse, whatever it solves elsewhere, and one in which bugs came back that the baseline had solved is, too.
    Two gamblers who do not win on average do not do so together.

    Attributes:
        worse: discordant pairs in which only the new policy failed; ``better``: in which only it passed.
        controls_worse: of them, those in controls; ``controls_better`` likewise.
    """

    alpha: float
    worse: int = 0
    better: int = 0
    controls_worse: int = 0
    controls_better: int = 0
    _most: float = 1.0

    def see(self, *, worse: bool, control: bool) -> None:
        """One more discordant pair."""
        self.worse += worse
        self.better += not worse
        self.controls_worse += worse and control
        self.controls_better += not worse and control
        self._most = max(self._most, self._wealth())

    @property
    def p_value(self) -> float:
        """Valid whenever it is looked at (Johari et al. 2022, <https://doi.org/10.1287/opre.2021.2135>)."""
        return 1 / self._most

    @property
    def alarm(self) -> bool:
        """Whether the new policy is worse, at ``alpha``."""
        return self.p_value <= self.alpha

    @property
    def needed(self) -> int:
        """The fewest more broken controls that would make an alarm."""
        return next(more for more in count() if self._wealth(more) >= 1 / self.alpha)

    def hopeless(self, left: int) -> bool:
        """Whether no alarm can come of this many more pairs: not even if all are broken controls."""
        return not self.alarm and left < self.needed

    def _wealth(self, more: int = 0) -> float:
        everywhere = wealth(self.worse + more, self.better)
        return (everywhere + wealth(self.controls_worse + more, self.controls_better)) / 2
