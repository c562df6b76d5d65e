"""Attribution: finds out which units a failing scene needs in order to fail, test by test."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.common.arrays import Mask
from vlafuzz.search.causes.background import Background
from vlafuzz.search.causes.rules import Rule
from vlafuzz.search.causes.suspects import FIRM, Ended, Suspects
from vlafuzz.search.causes.units import Levels, Units

SURE = 0.95  # probability of a set of units from which on it only has to be shown that none can be missing
LARGEST = 4  # units of a cause
FEW, MOST = (12, 30), (22, 45)  # tests of a firm failure and of others: by suspicion, and in all
ALONE = 24  # tests of a scene that deviates in one unit, in all
LONGER = 2.0  # times the background: so much longer do attributions take where policies fail by chance
BY_CHANCE = 0.95  # probability that a failure is one by chance from which it is given up
REPEATED = 4  # rollouts of a scene before it is said to show a cause
WITHOUT = 2  # and of it without one of its units: of rows from 300 rollouts 98 % are true, with one rollout 93 %


class Attribution:
    """One failing scene, with what is known about its cause.

    Tests are chosen by how much they tell about the suspects, until one of them is almost sure or that takes too long.
    Then units are removed one by one from the smallest set that failed, until it takes all of them. That answer, which
    was chosen for its outcomes, is confirmed by tests that it does not rest on: with all of its units the scene fails
    more often than by chance, and without any one of them it does not. After an answer that is refuted, another one is
    looked for.

    Args:
        confirmed: log likelihood ratio that tests of the answer have to show.
        answer: the units that a predecessor's cause takes, if any, which are confirmed or refuted as an answer is.

    Attributes:
        inherited: there was such an answer, and the scene need not have failed.
        waiting: the outcome of a test is awaited.
        cause: the units, once no further test is needed; None if there is no answer.
        scene: the units of the scene that shows it: the cause's, and those whose reset is not fair.
    """

    def __init__(
        self, levels: Levels, suspects: Suspects, background: Background, *, confirmed: float, answer: Mask | None
    ) -> None:
        self.levels, self.suspects = levels, suspects
        self._background, self._confirmed = background, confirmed
        self._longer = 1 + LONGER * background.rate
        self.waiting, self._sure = False, False
        self._looked = 0.0  # number of tests when the last answer was refuted
        self.cause: Mask | None = None
        self.scene: Mask | None = None
        self._answer, self.inherited = answer, answer is not None
        self._outcomes = defaultdict[bytes, list[Ended]](list)  # of the tests that confirm the answer

    @property
    def answered(self) -> bool:
        """Whether there was an answer to confirm, of several that were possible."""
        return (self._answer is not None or self._looked > 0) and int(self.suspects.deviating.sum()) > 1

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the next test; None if no further one is needed."""
        suspects, is_alone = self.suspects, self.suspects.deviating.sum() == 1
        few, most = (self._longer * tests for tests in (FEW if suspects.rate > FIRM else MOST))
        while suspects.by_chance <= BY_CHANCE and suspects.tests < (ALONE if is_alone else 2 * most):
            if self._answer is None:
                kept = None if is_alone else self._look(few, most, rng)
                if kept is not None:
                    return kept
                answer = suspects.deviating if is_alone else suspects.smallest
                if answer.sum() > LARGEST or not (is_alone or self._sure or suspects.tests - self._looked < most):
                    return None
                self._answer = answer
                self._outcomes.clear()
            kept = self._confirm()
            if kept is not None or self.cause is not None or is_alone or self.inherited:
                return kept
            self._answer, self._looked = None, suspects.tests  # refuted: what was learnt may show another one
        return None

    def _look(self, few: float, most: float, rng: np.random.Generator) -> Mask | None:
        """The next test without an answer: by suspicion, then with a unit less than the smallest set that failed."""
        tests = self.suspects.tests - self._looked
        kept = self.suspects.next_test(rng) if not self._sure and tests < few else None
        return self.suspects.without_one() if kept is None and tests < most else kept

    def learn(self, kept: Mask, ended: Ended) -> None:
        """Learn the outcome of a test."""
        if not kept.any():
            self._background.learn(failed=bool(ended))
            return
        if self._answer is not None:
            self._outcomes[kept.tobytes()].append(ended)
        self.suspects.learn_test(kept, ended)
        chance, has_failed = self.suspects.best()
        self._sure = chance >= SURE and has_failed

    def _confirm(self) -> Mask | None:
        """The next test of the answer; None if it is confirmed or refuted."""
        assert self._answer is not None
        answer, mark = self._answer, self._answer.tobytes()
        outcomes = self._outcomes[mark]
        scene = self._ratio(outcomes)
        if scene < -self._confirmed:
            return None
        if scene < self._confirmed or self.suspects.rollouts(answer) < REPEATED:
            usual = self._background.outcomes
            compared = answer.sum() > 1 or not any(usual) or len(usual) >= len(outcomes)
            return answer if compared else np.zeros_like(answer)  # the reference, without which it tells little
        needed = answer.copy()
        for unit in np.flatnonzero(answer):
            without = answer.copy()
            without[unit] = False
            if not without.any():  # the reference, whose failures make the background
                continue
            found = self._ratio(self._outcomes[without.tobytes()])
            if self.suspects.is_unfair(without):
                needed[unit] = self.suspects.rollouts(without) > 0 and self.suspects.evidence(without) < 0
                continue
            if found > self._confirmed:
                self._answer = without
                self._outcomes.clear()
                return without
            if found > -self._confirmed or self.suspects.rollouts(without) < WITHOUT:
                return without
        if needed.any():
            self.cause, self.scene = needed, answer
        return None

    def _ratio(self, outcomes: Sequence[Ended]) -> float:
        """Log likelihood ratio of tests of the answer: their units are in a fault, or they are not."""
        return self.suspects.ratio([outcomes.count(ended) for ended in Ended], self._background.chances)

    def tests(self, units: Units) -> dict[str, tuple[bool, ...]]:
        """The tests of the cause, see ``Cause``; none unless each resets one operator, and to nominal."""
        assert self.cause is not None
        names = units.operators(self.cause)
        nominal = all(units.reference == [gene.grid.nominal_level for gene in units.genes])
        if not nominal or len(names) < self.cause.sum() or (self.cause != self.scene).any():
            return {}
        tests = {"": tuple(map(bool, self._outcomes[self.cause.tobytes()]))}
        for name, unit in zip(names, np.flatnonzero(self.cause), strict=True):
            without = self.cause.copy()
            without[unit] = False
            outcomes = self._outcomes[without.tobytes()] if without.any() else self._background.outcomes
            tests[name] = tuple(map(bool, outcomes))
        return tests


@dataclass(frozen=True, eq=False)
class Test:
    """A scene with only some units kept: for an attribution, to try a rule on it, or for the background.

    Attributes:
        failure: whether the rule is to explain a failure; else its range is probed.
        chance: probability that the scene is in the range of the rule, so far.
        trial: number of rollouts for that, this one included.
        alone: it shows what a single unit does.
    """

    scene: Levels
    kept: Mask
    attribution: Attribution | None = None
    rule: Rule | None = None
    failure: bool = False
    chance: float = 0.5
    trial: int = 1
    alone: bool = False
