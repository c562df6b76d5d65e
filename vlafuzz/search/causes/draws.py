"""Draws: random scenes, fewer of those that known causes explain, and severe ones while failures are rare."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from vlafuzz.probability import Draw, Probability, failure_probability
from vlafuzz.search.base import Genome
from vlafuzz.search.causes.rules import Rule, Rules
from vlafuzz.search.causes.units import Numbers, Units
from vlafuzz.search.proposals import ProposalFactory
from vlafuzz.statistics import wilson

SUPPLY = 3  # random scenes of which one is proposed, once there are rules
FLOOR = 0.3  # of the weight of a scene that is explained: a wrong rule is found out, and bounds hold
STRETCHED = 0.5  # largest share of scenes that are made more severe: none where a third of all fail
RECENT = 30  # scenes by which that is judged
POOL, ENOUGH = 2000, 100  # random scenes by which shares are estimated, at most and at least
EXPLAINED, SURELY = 0.5, 0.95  # chance from which on a scene counts as explained, and is surely in a range
NO_BUDGET = 1000  # rollouts that a run without a budget is taken to have


class Draws:
    """Draws scenes, and estimates from those that are not stretched how often the policy fails.

    Of some random scenes one is taken with a probability proportional to ``h``, which is small where a rule
    explains the failure: ``mean(h) / h`` of the scene that is taken is an unbiased weight.
    """

    def __init__(self, proposals: ProposalFactory, budget: int | None, stretched: float) -> None:
        self._proposals = proposals
        self._budget, self._stretched = budget or NO_BUDGET, stretched
        self._pool: Numbers = np.zeros((0, 0))  # deviations of random scenes
        self._recent: deque[bool] = deque(maxlen=RECENT)
        self._open: dict[int, Draw] = {}
        self._judged: dict[int, Draw] = {}

    def draw(self, number: int, rng: np.random.Generator, units: Units, rules: Rules) -> Genome:
        """A scene for the proposal with this number."""
        severe = rng.random() < self._stretched * self._rarity()
        supply = SUPPLY if rules else 1
        genomes = [self._candidate(units, rng, severe=severe) for _ in range(supply)]
        deviations = units.deviations(np.array([units.levels(genome) for genome in genomes]))
        explained = rules.explain(deviations, units)
        worths = np.maximum(1 - explained, FLOOR)
        taken = int(rng.choice(supply, p=worths / worths.sum()))
        if not severe:
            self._open[number] = self._density(number, worths, explained, taken, units, rules)
            self._pool = np.concatenate([self._pool, deviations])[-POOL:] if len(self._pool) else deviations
        return self._proposals.registered(genomes[taken])

    def learn(self, number: int, *, failed: bool, explained: float) -> None:
        """Learn the outcome of a scene that was rolled out."""
        self._recent.append(failed and explained < EXPLAINED)
        if number in self._open:
            self._judged[number] = replace(self._open.pop(number), failed=failed)

    def forget(self) -> None:
        """There is another reference: deviations from the old one are of no use."""
        self._pool = np.zeros((0, 0))

    def probability(self) -> Probability:
        """The probability that the policy fails in a random scene; its interval holds at any time."""
        return failure_probability([self._judged[number] for number in sorted(self._judged)])

    def share(self, rule: Rule, units: Units) -> Probability | None:
        """The share of random scenes in a rule's range; the interval allows for doubt about the range."""
        size = len(self._pool)
        if size < ENOUGH:
            return None
        chances = rule.chance(self._pool, units)
        low, high = wilson(int((chances >= SURELY).sum()), size)[0], wilson(int((chances > 0).sum()), size)[1]
        return Probability(float(chances.mean()), low, high)

    def _density(
        self, number: int, worths: Numbers, explained: Numbers, taken: int, units: Units, rules: Rules
    ) -> Draw:
        """What is known of a draw before its outcome: its weight, and what rules predict."""
        known = len(self._pool) >= ENOUGH
        return Draw(
            failed=False,
            left=max(self._budget - number, 1),
            weight=float(worths.mean() / worths[taken]),
            heaviest=1 / FLOOR,
            heaviest_miss=1 if known else math.inf,
            prediction=float(explained[taken]) if known else 0.0,
            mean_prediction=float(rules.explain(self._pool, units).mean()) if known else 0.0,
        )

    def _rarity(self) -> float:
        """How rare unexplained failures have been of late: 1 for none, 0 from a third of all scenes on."""
        return max(0.0, 1 - 3 * float(np.mean(self._recent))) if self._recent else 1.0

    def _candidate(self, units: Units, rng: np.random.Generator, *, severe: bool) -> Genome:
        genome = self._proposals.drawn(rng)
        if not severe:
            return genome
        return self._proposals.fair(units.genome(units.stretched(units.levels(genome), rng)), rng)
