"""Power: which loss of the pass rate a comparison with recorded outcomes notices, before anything is run.

Computed exactly, by dynamic programming over the sequential sign test in the order of the controls. The model
is a policy that passes in each control with one probability, whatever the baseline did there. This is
conservative: a policy that is related to the baseline differs from it in fewer controls by chance. The
baseline's true pass rate is known only from its outcomes, so the power is the mean over its posterior with
Jeffreys' prior (assurance: O'Hagan et al. 2005, <https://doi.org/10.1002/pst.175>).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from math import ceil

import numpy as np
from numpy.typing import NDArray

from vlafuzz.failures.corpus.e_process import SignTest, wealth

Floats = NDArray[np.float64]

POWER = 0.9
ASKED = 0.93  # of that mean, so that POWER holds at any one true rate (scripts/simulate_power.py)
RATES = 40  # steps of the new policy's pass rate, between which the power is interpolated
QUANTILES = (np.arange(25) + 0.5) / 25  # of the baseline's pass rate


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
    """What is noticed in controls with these outcomes of the baseline, in their order."""
    from scipy.special import betaincinv

    passing, fewest = sum(passed), SignTest(alpha).needed
    if passing < fewest:
        return Power(passing, len(passed), fewest, 1.0)
    baseline = betaincinv(passing + 0.5, len(passed) - passing + 0.5, QUANTILES)
    rates = np.linspace(0, baseline[-1], RATES + 1)
    alarms = np.array([alarm_probability(passed, rate, alpha) for rate in rates])

    def power(loss: float) -> float:
        return float(np.interp(np.maximum(baseline - loss, 0), rates, alarms).mean())

    losses = np.linspace(0, baseline[-1], 1001)
    return Power(passing, len(passed), fewest, next(loss for loss in losses if power(loss) >= ASKED))


def alarm_probability(passed: Sequence[bool], rate: float, alpha: float) -> float:
    """The probability of an alarm where the new policy passes with probability ``rate`` in each control.

    Args:
        passed: outcomes of the baseline.
    """
    limits = _limits(alpha, sum(passed))[: len(passed) - sum(passed) + 1]
    if not limits:
        return 0.0
    state = np.zeros((sum(passed) + 1, len(limits)))  # without an alarm so far, by worse and better pairs
    state[0, 0], alarm, better = 1.0, 0.0, np.arange(len(limits))
    for was in passed:
        happens = state * ((1 - rate) if was else rate)
        state -= happens
        if was:
            state[1:] += happens[:-1]
            alarm += state[limits, better].sum()
            state[limits, better] = 0.0
        else:
            state[:, 1:] += happens[:, :-1]
    return float(alarm)


@cache
def _limits(alpha: float, most: int) -> list[int]:
    """The number of worse pairs that makes an alarm, by better ones; as long as that is ``most`` or less."""
    limits, worse = list[int](), 0
    for better in count():
        while wealth(worse, better) < 1 / alpha:
            worse += 1
        if worse > most:
            return limits
        limits.append(worse)
    raise AssertionError
