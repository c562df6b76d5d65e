"""Severity: random scenes of ranges scaled towards nominal, and the scale at which a policy fails in one half."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vlafuzz.search.base import Genome
from vlafuzz.search.proposals import UNLIMITED, OneByOne, Rng

NAME = "severity"  # of the strategy
_HALVES = np.linspace(0.0, 1.0, 201)  # candidates for the severity at which one half fails
_FALL = 3.841 / 2  # of the log likelihood in the interval: half of the 95 % quantile of chi-square with one degree
_SLOPES = np.geomspace(0.5, 60.0, 60)  # of the log odds, for each unit of severity: flat to a step


def severity_of(number: int) -> float:
    """The severity of the proposal with this number: van der Corput's sequence in base 2, which fills (0, 1) evenly."""
    digits = f"{number + 1:b}"[::-1]
    return float(int(digits, 2)) / 2.0 ** len(digits)


class Severity(OneByOne):
    """Draws scenes of narrower ranges: how far they have to reach for the policy to fail in one half."""

    outstanding = UNLIMITED

    def _genome(self, number: int, rng: Rng) -> Genome:
        return self._space.encode(self._space.narrowed(severity_of(number)).sample(rng))


class Half(NamedTuple):
    """The severity at which a policy fails in one half of the scenes, with a 95 % interval.

    An end of 0 or 1 is open: it fails as often in nominal scenes, or does not fail as often in the ranges as they are.
    """

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if self.low >= 1:
            return "above 1: fewer than one half fail in the whole ranges"
        if self.high <= 0:
            return "0: nominal scenes fail as often"
        return f"{self.value:.2f} of the ranges, 95% interval {self.low:.2f}–{self.high:.2f}{'+' * (self.high >= 1)}"


def half_of(outcomes: Sequence[tuple[float, bool]]) -> Half:
    """The severity at which one half fails, by severities and whether these scenes failed.

    The probability of a failure is logistic in the severity, and does not fall. The interval is that of the profile
    likelihood (Venzon and Moolgavkar 1988 <https://doi.org/10.2307/2347496>).
    """
    from scipy.special import expit  # which takes a while to import

    if not outcomes:
        return Half(0.5, 0.0, 1.0)
    severities, failed = np.array([at for at, _ in outcomes]), np.array([bad for _, bad in outcomes])
    odds = _SLOPES[None, :, None] * (severities - _HALVES[:, None, None])
    chances = np.clip(expit(odds), 1e-9, 1 - 1e-9)
    likely = np.where(failed, np.log(chances), np.log1p(-chances)).sum(axis=2).max(axis=1)
    within = _HALVES[likely >= likely.max() - _FALL]
    return Half(float(_HALVES[int(likely.argmax())]), float(within[0]), float(within[-1]))
