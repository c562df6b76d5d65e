"""Attribution: finds out which units a failing scene needs in order to fail, test by test."""

from __future__ import annotations

import numpy as np

from vlafuzz.search.causes.suspects import FIRM, Mask, Suspects
from vlafuzz.search.causes.units import Levels

SURE = 0.95  # probability of a set of units from which on it only has to be shown that none can be missing
LARGEST = 4  # units of a cause
FEW, MOST = (12, 30), (22, 45)  # tests of a firm failure and of others: by suspicion, and in all


class Attribution:
    """One failing scene, with what is known about its cause.

    Tests are chosen by how much they tell about the suspects, until one of them is almost sure or that takes
    too long. Then units are removed one by one from the smallest set that failed, until it takes all of them.

    Attributes:
        waiting: the outcome of a test is awaited.
        cause: the units, once no further test is needed; None if there is no answer.
    """

    def __init__(self, levels: Levels, suspects: Suspects, *, guided: bool = True) -> None:
        self.levels, self.suspects, self._guided = levels, suspects, guided
        self.waiting, self._sure = False, False
        self.cause: Mask | None = None

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the next test; None if no further one is needed."""
        suspects = self.suspects
        few, most = FEW if suspects.rate > FIRM else MOST
        guided = self._guided and not self._sure and suspects.tests < few
        kept = suspects.next_test(rng) if guided else None
        if kept is None and suspects.tests < most:
            kept = suspects.without_one()
        answered = kept is None and (self._sure or suspects.tests < most)
        if answered and suspects.smallest.sum() <= LARGEST:
            self.cause = suspects.smallest
        return kept

    def learn(self, kept: Mask, *, failed: bool) -> None:
        """Learn the outcome of a test."""
        self.suspects.learn_test(kept, failed=failed)
        chance, has_failed = self.suspects.best()
        self._sure = chance >= SURE and has_failed
