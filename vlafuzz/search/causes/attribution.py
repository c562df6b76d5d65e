"""Attribution: finds out which units a failing scene needs in order to fail, test by test."""

from __future__ import annotations

import numpy as np

from vlafuzz.search.causes.suspects import FIRM, Mask, Suspects
from vlafuzz.search.causes.units import Levels

SURE = 0.95  # probability of a set of units that ends an attribution
LARGEST = 4  # units of a cause
FEW, MOST = (12, 30), (22, 45)  # tests of a firm failure and of others: by suspicion, and in all


class Attribution:
    """One failing scene, with what is known about its cause.

    Tests are chosen by how much they tell about the suspects. Where that does not end soon, units are removed
    one by one from the smallest set that failed.

    Attributes:
        waiting: the outcome of a test is awaited.
        ended: whether no further test is needed; ``cause`` holds the units then, None if there is no answer.
    """

    def __init__(self, levels: Levels, suspects: Suspects, *, guided: bool = True) -> None:
        self.levels, self.suspects, self._guided = levels, suspects, guided
        self.waiting, self.ended = False, False
        self.cause: Mask | None = None

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the next test; None if the attribution has ended."""
        suspects = self.suspects
        few, most = FEW if suspects.rate > FIRM else MOST
        kept = suspects.next_test(rng) if self._guided and suspects.tests < few else None
        if kept is None and suspects.tests < most:
            kept = suspects.without_one()
            if kept is None and suspects.smallest.sum() <= LARGEST:
                self.cause = suspects.smallest
        self.ended = kept is None
        return kept

    def learn(self, kept: Mask, *, failed: bool) -> None:
        """Learn the outcome of a test."""
        self.suspects.learn_test(kept, failed=failed)
        best, chance, has_failed = self.suspects.best()
        if chance >= SURE and has_failed:
            self.cause, self.ended = best, True
