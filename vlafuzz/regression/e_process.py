"""A one-sided sequential sign test that may be evaluated after every pair: is the new policy worse?

Of two policies in the same scene, only a discordant pair tells them apart: one passes and the other fails
(McNemar 1947, <https://doi.org/10.1007/BF02295996>). If the policies are equally good, each is the failing
one with probability 1/2, whatever the scene and the history; so a bet on "the new one fails, with probability
p" multiplies the bettor's wealth by ``2p`` or ``2(1 - p)``, and has no expected gain. Neither has a mixture
of such bets over p (Robbins 1970, <https://doi.org/10.1214/aoms/1177696786>). By Ville's inequality (1939),
the wealth then ever reaches ``1 / alpha`` with probability at most ``alpha``. So the test may stop at any
time, with an alarm or because none can follow, and the probability of a false alarm over the whole test is at
most ``alpha`` (Ramdas et al. 2023, <https://doi.org/10.1214/23-STS894>).
"""

from dataclasses import dataclass, field
from functools import cache
from itertools import count
from math import comb

# Most of the wealth is on "nearly always the new one fails", as with a broken policy: then five pairs of five
# raise an alarm at 5 %, and no test can do with fewer (1/2 to the fifth is 3 %). The rest is spread over p.
_NEARLY_ALWAYS, _STAKE = 0.95, 0.7


@cache
def wealth(worse: int, better: int) -> float:
    """Wealth after these discordant pairs, from 1, of betting that the new policy is worse."""
    pairs = worse + better
    nearly = (2 * _NEARLY_ALWAYS) ** worse * (2 - 2 * _NEARLY_ALWAYS) ** better
    # The mean of (2p)^worse (2 - 2p)^better over p in [1/2, 1]: an incomplete beta integral, in closed form.
    spread = sum(comb(pairs + 1, k) for k in range(worse + 1)) / ((pairs + 1) * comb(pairs, worse))
    return _STAKE * nearly + (1 - _STAKE) * spread


@dataclass
class SignTest:
    """The state of the test.

    Half of the wealth is bet on all scenes, and half on the controls alone: a policy that fails controls is
    worse, even if it solves other scenes, and so is a policy that fails again where the baseline had
    improved. The mean of two such e-processes is one, too.

    Attributes:
        worse: discordant pairs in which only the new policy failed; ``better``: in which only it passed.
        controls_worse, controls_better: those of them in controls.
    """

    alpha: float
    worse: int = 0
    better: int = 0
    controls_worse: int = 0
    controls_better: int = 0
    _most: float = field(default=1.0, init=False)

    def see(self, *, worse: bool, control: bool) -> None:
        self.worse += worse
        self.better += not worse
        self.controls_worse += worse and control
        self.controls_better += not worse and control
        self._most = max(self._most, self._wealth())

    @property
    def p_value(self) -> float:
        """Valid at any time (Johari et al. 2022, <https://doi.org/10.1287/opre.2021.2135>)."""
        return 1 / self._most

    @property
    def alarm(self) -> bool:
        """Whether the new policy is worse, at level ``alpha``."""
        return self.p_value <= self.alpha

    @property
    def needed(self) -> int:
        """The number of further failed controls that would raise an alarm."""
        return next(more for more in count() if self._wealth(more) >= 1 / self.alpha)

    def hopeless(self, left: int) -> bool:
        """Whether no alarm is possible within ``left`` more pairs, even if all are failed controls."""
        return not self.alarm and left < self.needed

    def _wealth(self, more: int = 0) -> float:
        everywhere = wealth(self.worse + more, self.better)
        return (everywhere + wealth(self.controls_worse + more, self.controls_better)) / 2
