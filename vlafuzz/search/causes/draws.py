"""Draws: random scenes, and others that are made severe where known causes do not explain a failure."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import wilson
from vlafuzz.search.base import Genome
from vlafuzz.search.causes.rules import Rule, Rules
from vlafuzz.search.causes.units import Levels, Numbers, Units
from vlafuzz.search.probability import Draw, Probability, failure_probability
from vlafuzz.search.proposals import ProposalFactory

SUPPLY = 8  # candidates for a severe scene
STRETCHED = 0.5  # largest share of draws that are made severe: fewer where failures are frequent
LEAST = 0.15  # of all proposals are random scenes as they are: the probability rests on them alone
MOVED = (0.5, 0.8)  # share of the numbers of a severe scene that are moved, by how rare failures are
AVERSE = 3  # exponent: the larger, the less often a candidate is taken whose failure a rule may explain
RECENT = 30  # draws by which that is judged
SAMPLE = 600  # random scenes by which shares are estimated, and of which severe ones are made
EXPLAINED, SURELY = 0.5, 0.95  # chance from which on a scene counts as explained, and is surely in a range
FAILING, WORTH = 0.8, 2.0  # prior of the failure rate in a rule's range, and how many scenes it is worth
NO_BUDGET = 1000  # rollouts that a run without a budget is taken to have


class Draws:
    """Draws scenes, and estimates from those that are not severe how often the policy fails."""

    def __init__(self, proposals: ProposalFactory, seed: int, budget: int | None, stretched: float) -> None:
        self._proposals, self._seed = proposals, seed
        self._budget, self._stretched = budget or NO_BUDGET, stretched
        self._sample: NDArray[np.int64] | None = None  # levels of random scenes
        self._deviations: Numbers | None = None  # theirs
        self._recent: deque[bool] = deque(maxlen=RECENT)
        self._plain = 0
        self._open: dict[int, Draw] = {}
        self._judged: dict[int, Draw] = {}
        self._seen: list[tuple[Levels, bool]] = []  # random scenes that were rolled out, and which failed

    def due(self, asked: int) -> bool:
        """Whether there are fewer random scenes among so many proposals than the probability needs."""
        return self._plain < LEAST * asked

    def draw(self, number: int, rng: np.random.Generator, units: Units, rules: Rules) -> Genome:
        """A scene for the proposal with this number."""
        if not self.due(number) and rng.random() < self._stretched * self._rarity():
            return self._severe(rng, units, rules)
        self._plain += 1
        genome = self._proposals.fresh(rng)
        here = units.deviations(units.levels(genome)[None])
        self._open[number] = Draw(
            failed=False,
            left=max(self._budget - number, 1),
            prediction=float(rules.explain(here, units)[0]),
            mean_prediction=float(rules.explain(self._random(units), units).mean()) if rules else 0.0,
        )
        return genome

    def learn(self, number: int, levels: Levels, *, failed: bool, explained: float) -> None:
        """Learn the outcome of a scene that was rolled out."""
        self._recent.append(failed and explained < EXPLAINED)
        if number in self._open:
            self._seen.append((levels, failed))
            self._judged[number] = replace(self._open.pop(number), failed=failed)

    def forget(self) -> None:
        """There is another reference: deviations from the old one are of no use."""
        self._deviations = None

    @property
    def judged(self) -> list[int]:
        """The numbers of the random scenes that passed or failed."""
        return sorted(self._judged)

    def probability(self) -> Probability:
        """The probability that the policy fails in a random scene; its interval holds at any time."""
        return failure_probability([self._judged[number] for number in self.judged])

    def share(self, rule: Rule, units: Units) -> Probability:
        """The share of random scenes that fail for a rule's reason.

        That is the share in the rule's range, times the rate at which random scenes fail there beyond that elsewhere.
        The interval allows for doubt about range and rate, and for no other reason at its end.
        """
        chances = rule.chance(self._random(units), units)
        low = wilson(int((chances >= SURELY).sum()), SAMPLE).low
        high = wilson(int((chances > 0).sum()), SAMPLE).high
        rate, other = self._rates(rule, units)
        beyond = [max(0.0, (value - other) / (1 - other)) for value in (rate.value, rate.low)]
        return Probability(float(chances.mean()) * beyond[0], low * beyond[1], high * rate.high)

    def _rates(self, rule: Rule, units: Units) -> tuple[Probability, float]:
        """The failure rates of random scenes in a rule's range and elsewhere."""
        if not self._seen:
            return Probability(1.0, 0.0, 1.0), 0.0
        levels, failed = map(np.array, zip(*self._seen, strict=True))
        inside = rule.chance(units.deviations(levels), units)
        failures, scenes = float(inside @ failed), float(inside.sum())
        rate = (failures + FAILING * WORTH) / (scenes + WORTH)
        elsewhere = float((1 - inside) @ failed) / (len(levels) - scenes + 1)
        return Probability(rate, *wilson(failures, scenes)), elsewhere

    def _random(self, units: Units) -> Numbers:
        """``(SAMPLE, units + 1)`` deviations of random scenes."""
        if self._deviations is None:
            self._deviations = units.deviations(self._random_levels(units))
        return self._deviations

    def _random_levels(self, units: Units) -> NDArray[np.int64]:
        """``(SAMPLE, dim)`` levels of random scenes, the same in the whole run."""
        if self._sample is None:
            rng = np.random.default_rng([self._seed, SAMPLE, 1])
            self._sample = np.array([units.levels(self._proposals.drawn(rng)) for _ in range(SAMPLE)])
        return self._sample

    def _severe(self, rng: np.random.Generator, units: Units, rules: Rules) -> Genome:
        """One of a few severe scenes, more likely one in which no rule explains a failure."""
        least, most = MOVED
        share = least + (most - least) * self._rarity()
        drawn = self._random_levels(units)[rng.integers(SAMPLE, size=SUPPLY)]
        severe = np.array([units.stretched(levels, share, rng) for levels in drawn])
        worths = (1 - rules.explain(units.deviations(severe), units)) ** AVERSE + 1e-6
        taken = severe[rng.choice(SUPPLY, p=worths / worths.sum())]
        return self._proposals.first_new(lambda: units.genome(taken), rng)

    def _rarity(self) -> float:
        """How rare unexplained failures have been of late: 1 for none."""
        return 1 - float(np.mean(self._recent)) if self._recent else 1.0
