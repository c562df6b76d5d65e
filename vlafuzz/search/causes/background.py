"""Background: how often a policy fails where no cause is, and how many failures that explains."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from vlafuzz.common.arrays import Array

RATES = np.array([0.04, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])  # of failure by chance; one holds
PRIOR = np.array([0.5, 0.1, 0.08, 0.07, 0.06, 0.05, 0.05, 0.04, 0.03, 0.02])
BEYOND, WORTH = 0.3, 4.0  # prior of the share of scenes that fail for a cause, and how many draws it is worth
# Rollouts of the reference at most, and at first; more only of a policy that fails there. With four,
# more lists of failures without a cause were not empty.
NOMINAL, SOON = 20, 8
SHORT = 40  # proposals, of which two alone are spent on the reference at first
SHARE, OFTEN = 30, 15  # proposals for each of them, and if it fails there: few where the budget is small
PASSED = 2  # rollouts that have to pass for the nominal scene to be the reference
RAREST, SUREST = 0.05, 0.98  # least such share, and most probability that a failure is one by chance


class Background:
    """Learns from the reference, and from scenes that are nearly it: in others another cause may be left.

    Attributes:
        has_reference: whether there is one: the nominal scene is, once it has passed.
        asked: rollouts of the reference that were asked for, without its first; outcomes: of it, whether each failed.
        lost: how many failures that no known cause explains lost each stage.
    """

    def __init__(self, *, has_reference: bool = False) -> None:
        self.has_reference, self.asked = has_reference, 0
        self.outcomes: list[bool] = []
        self.lost = defaultdict[str, float](float)
        self._log = np.log(PRIOR)
        self._draws = self._failing = 0.0

    @property
    def chances(self) -> Array:
        """The probability of each of ``RATES``."""
        weights = np.exp(self._log - self._log.max())
        return np.asarray(weights / weights.sum())

    @property
    def rate(self) -> float:
        """The expected failure rate where no cause is."""
        return float(self.chances @ RATES)

    @property
    def by_chance(self) -> float:
        """The probability that a failure which no known cause explains is one by chance."""
        rate = (self._failing + BEYOND * WORTH) / (self._draws + WORTH)
        return self.by_chance_of(max(RAREST, (rate - self.rate) / (1 - self.rate)))

    def by_chance_of(self, share: float) -> float:
        """The same, where this share of scenes fails for a cause."""
        chance = self.rate * (1 - share)
        return min(SUREST, chance / (chance + share))

    def is_due(self, proposals: int, budget: int | None) -> bool:
        """Whether another rollout of the reference is due after so many proposals."""
        few = proposals // SHARE + 1
        if any(self.outcomes) or not self.has_reference:
            few = min(NOMINAL, (budget or NOMINAL * OFTEN) // OFTEN)
        soon = SOON
        if budget:
            soon = PASSED if budget < SHORT else min(SOON, budget // OFTEN)
        return self.asked + 1 < min(NOMINAL, max(few, soon))

    def usual(self, lost: str, by_chance: float) -> tuple[float, float]:
        """The share of failures by chance that lose this stage, and the probability that one which did is one of these.

        ``by_chance``: that probability without the stage. Causes are taken to lose each stage equally often.
        """
        stages = max(2, len(self.lost))
        share = (self.lost[lost] + 1) / (sum(self.lost.values()) + stages)
        return share, by_chance * share * stages / (by_chance * share * stages + 1 - by_chance)

    def learn(self, *, failed: bool) -> None:
        """Learn an outcome of the reference."""
        self.outcomes.append(failed)
        self.has_reference = self.has_reference or self.outcomes.count(False) >= PASSED
        self._log += np.log(RATES if failed else 1 - RATES)

    def learn_alone(self, share: float, *, failed: bool) -> None:
        """Learn from a scene with one unit off the reference, of which such a share fails for a cause."""
        failing = RATES + (1 - RATES) * share
        self._log += np.log(failing if failed else 1 - failing)

    def learn_draw(self, unexplained: float, *, failed: bool) -> None:
        """Learn the outcome of a draw, by the probability that no known cause explains a failure there."""
        self._draws += unexplained
        self._failing += unexplained * failed
