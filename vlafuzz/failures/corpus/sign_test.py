"""The test of a comparison in random scenes, whether the new policy is worse, and the loss that it notices.

Of two policies in the same scene, only a discordant pair tells them apart: one passes and the other fails (McNemar
1947, <https://doi.org/10.1007/BF02295996>). In scenes drawn at random, independently of each other, policies that fail
equally often are each the failing one with probability 1/2, however different they are. So a bet on "the new one fails,
with probability p" multiplies the bettor's wealth by ``2p`` or ``2(1 - p)``, and has no expected gain; neither has a
mixture of such bets. By Ville's inequality (1939), the wealth then ever reaches ``1 / a`` with probability at most
``a``, so that the test may stop there at any time (Ramdas et al. 2023, <https://doi.org/10.1214/23-STS894>). This gets
a tenth of alpha; the exact sign test of all controls at the end, which finds more, gets the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from math import ceil, exp

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import Counts, sign_p

Floats = NDArray[np.float64]

# In 200 scenes, with outcomes that are independent of the baseline's and a pass rate of one half, this finds
# a loss of 10 points in 59 %, and 3.9 % of equal policies raise an alarm; with all of alpha here, in 40 and
# 2.7 %.
EARLY = 0.1  # of alpha, for alarms before the end
BETS = ((0.5, 0.75), (0.5, 0.97))  # shares of the wealth, and p; a broken policy takes nine of nine

POWER = 0.9
ASKED = 0.93  # of the mean over the posterior, so that POWER holds at any one true rate (simulate_power.py)
RATES = 40  # steps of the new policy's pass rate, between which the power is interpolated
QUANTILES = (np.arange(25) + 0.5) / 25  # of the baseline's pass rate


def log_wealth(worse: Counts, better: Counts) -> Floats:
    """Logarithm of the wealth after these pairs, from 1, of betting that the new policy is worse."""
    logs = [np.log(share) + worse * np.log(2 * p) + better * np.log(2 - 2 * p) for share, p in BETS]
    return np.asarray(np.logaddexp(*logs))


@dataclass
class SignTest:
    """The state of the test.

    Attributes:
        alpha: bound on the probability of a false alarm.
        worse: discordant pairs in which only the new policy failed; ``better``: in which only it passed. whole: whether
        these are all the pairs that were planned.
    """

    alpha: float
    worse: int = 0
    better: int = 0
    whole: bool = False
    _most: float = field(default=0.0, init=False)

    def see(self, *, worse: bool) -> None:
        self.worse += worse
        self.better += not worse
        self._most = max(self._most, float(log_wealth(self.worse, self.better)))

    @property
    def p_value(self) -> float:
        """Valid whenever it is looked at; an alarm is not taken back."""
        early = exp(-self._most) / EARLY
        end = float(sign_p(self.worse, self.better)) / (1 - EARLY) if self.whole else 1.0
        return min(early, end, 1.0)

    @property
    def alarm(self) -> bool:
        """Whether the new policy is worse, at level ``alpha``."""
        return self.p_value <= self.alpha

    @property
    def needed(self) -> int:
        """The number of further pairs, all of them worse, that would raise an alarm."""

        def alarms(worse: int) -> bool:
            early = log_wealth(worse, self.better) >= -np.log(self.alpha * EARLY)
            return bool(early or (self.whole and sign_p(worse, self.better) <= self.alpha * (1 - EARLY)))

        return 0 if self.alarm else next(more for more in count() if alarms(self.worse + more))


@dataclass(frozen=True)
class Power:
    """What a comparison in controls with recorded outcomes can notice.

    Attributes:
        passed: controls that the baseline passes, of ``of``; only they can break.
        fewest: broken controls that an alarm takes at least.
        loss: the smallest loss of the pass rate, in [0, 1], that raises an alarm with probability ``POWER``.
    """

    passed: int
    of: int
    fewest: int
    loss: float

    @property
    def possible(self) -> bool:
        """Whether an alarm is."""
        return self.passed >= self.fewest

    @property
    def total(self) -> bool:
        """Whether only the loss of everything is noticed."""
        return self.loss * self.of >= self.passed

    def __str__(self) -> str:
        passing = f"{self.passed} of {self.of} controls pass"
        if not self.possible:
            return f"no alarm is possible: {passing}, and it takes {self.fewest} that break"
        power = f"with {POWER:.0%} power"
        if self.total:
            return f"{passing}: only the loss of everything is noticed {power}"
        return f"{passing}: a loss of {ceil(100 * self.loss)} points or more is noticed {power}"


def power_of(passed: Sequence[bool], alpha: float = 0.05) -> Power:
    """What is noticed in controls with these outcomes of the baseline, in their order.

    The model is a policy that passes in each control with one probability, whatever the baseline did there; one that is
    related to the baseline differs from it in fewer controls by chance. The power is the mean over the posterior of the
    baseline's pass rate with Jeffreys' prior (assurance: O'Hagan et al. 2005, <https://doi.org/10.1002/pst.175>).
    """
    from scipy.special import betaincinv

    passing, fewest = sum(passed), SignTest(alpha, whole=True).needed
    if passing < fewest:
        return Power(passing, len(passed), fewest, 1.0)
    baseline = betaincinv(passing + 0.5, len(passed) - passing + 0.5, QUANTILES)
    rates = np.linspace(0, baseline[-1], RATES + 1)
    alarms = np.array([alarm_probability(passed, rate, alpha) for rate in rates])

    def power(loss: float) -> float:
        return float(np.interp(np.maximum(baseline - loss, 0), rates, alarms).mean())

    losses = np.linspace(0, baseline[-1], 1001)
    return Power(passing, len(passed), fewest, next((loss for loss in losses if power(loss) >= ASKED), 1.0))


def alarm_probability(passed: Sequence[bool], rate: float, alpha: float) -> float:
    """The probability of an alarm at the end where the new policy passes with probability ``rate`` in each control.

    Alarms before the end, which the test at the end does not confirm, come on top: at most a tenth of ``alpha`` if it
    is as good.

    Args:
        passed: outcomes of the baseline.
    """
    from scipy.stats import binom

    breakable, others = sum(passed), len(passed) - sum(passed)
    worse, better = np.arange(breakable + 1)[:, None], np.arange(others + 1)[None]
    alarms = sign_p(worse, better) <= alpha * (1 - EARLY)
    return float((binom.pmf(worse, breakable, 1 - rate) * binom.pmf(better, others, rate) * alarms).sum())
