"""Draws: random scenes, and severe ones, at the ends of ranges where known causes do not explain a failure."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.search.base import Genome
from vlafuzz.search.causes.rules import Rules
from vlafuzz.search.causes.units import Levels, Units
from vlafuzz.search.probability import Draw, Probability, Rates, failure_probability, share_of_range, shared_out
from vlafuzz.search.proposals import ProposalFactory

SUPPLY = 8  # candidates for a severe scene
TOGETHER = 8  # units at the end of their ranges in a severe scene; with 6, a twentieth fewer causes at 20 % background
ENDS, FEW_ENDS = 10, 20  # proposals for each scene with one unit at an end, and in runs of fewer than 100
PLAIN = 0.5  # of all proposals are random scenes as they are: the probability rests on them alone
AVERSE = 3  # exponent: the larger, the less often a candidate is taken whose failure a rule may explain
# Random scenes without a rollout, by which shares are estimated: at first, for each proposal, and at most. One takes 2
# to 3 ms; four for each rollout add less than a tenth to the variance of a probability.
FIRST, MORE, MOST = 200, 4, 20_000


class Draws:
    """Draws scenes, and estimates from those that are not severe how often the policy fails."""

    def __init__(self, proposals: ProposalFactory, seed: int) -> None:
        self._proposals, self._seed = proposals, seed
        self._supply, self._wanted = list[Levels](), FIRST  # random scenes without a rollout; how many there are to be
        self._deviations: Array | None = None  # theirs
        self._ends: list[list[Levels]] | None = None  # see Units.ends
        self._coming: deque[tuple[Genome, float]] = deque()  # random scenes to draw, with coins in [0, 1)
        self._sampled, self._plain, self._concluded = 0, 0, False
        self._rates = Rates()
        self._open: dict[int, _Drawn] = {}
        self._judged: dict[int, _Drawn] = {}
        self._left_out: list[Draw] = []  # not rolled out

    def due(self, asked: int) -> bool:
        """Whether there are fewer random scenes among so many proposals than the probability needs."""
        return not self._concluded and self._plain < PLAIN * asked

    def conclude(self) -> None:
        """Draw severe scenes alone from now on."""
        self._concluded = True

    def alone(self, units: Units, budget: int | None) -> list[Levels]:
        """The reference with a single unit at an end of its range, in a random order, as many as the budget allows.

        Categories are left to random scenes.
        """
        columns = np.arange(len(units.units))
        scenes = [
            units.keep(end, columns == column)
            for column, ends in enumerate(self._farthest(units))
            if units.units[column].kind != "category"
            for end in ends
        ]
        most = len(scenes) if budget is None else budget // (ENDS if budget >= 100 else FEW_ENDS)
        return [scenes[index] for index in np.random.default_rng([self._seed, 3]).permutation(len(scenes))[:most]]

    def draw(self, number: int, rng: np.random.Generator, units: Units, rules: Rules) -> Genome:
        """A scene for the proposal with this number, of which the first is the reference."""
        if number == 0:
            return self._proposals.registered(units.genome(units.reference))
        self._wanted = min(FIRST + MORE * number, MOST)
        if not self.due(number):
            return self._severe(rng, units, rules)
        self._plain += 1
        share = float(rules.regions(self._random(units), units).any(axis=1).mean()) if rules else 0.0
        spread = abs(self._rates.predict(1.0) - self._rates.predict(0.0)) * math.sqrt(share * (1 - share))
        while True:
            self._sample(1)
            genome, coin = self._coming.popleft()
            levels = units.levels(genome)
            explained = bool(rules.regions(units.deviations(levels[None]), units).any())
            draw = Draw(
                scene=levels.tobytes(),
                chance=self._rates.chance(explained=explained),
                prediction=self._rates.predict(explained),
                mean_prediction=self._rates.predict(share),
                error=spread / math.sqrt(len(self._supply) or 1),
            )
            if coin < draw.chance:
                sample = not share or coin < self._rates.chance(explained=True)
                new = bool(self._proposals.new([genome])[0])
                self._open[number] = _Drawn(draw, levels, explained, sample, new)
                return self._proposals.registered(genome)
            self._left_out.append(draw)

    def ahead(self, asked: int, units: Units, rules: Rules) -> list[Genome]:
        """The random scenes among the proposals up to this number, as far as it is known now which are rolled out."""
        number = 0 if self._concluded else max(0, math.ceil(PLAIN * asked) - self._plain)
        self._sample(number)
        coming = list(islice(self._coming, number))
        levels = np.array([units.levels(genome) for genome, _ in coming] or [units.reference])
        inside = rules.regions(units.deviations(levels), units)
        chances = [self._rates.chance(explained=bool(row.any())) for row in inside]
        return [genome for (genome, coin), chance in zip(coming, chances, strict=False) if coin < chance]

    def is_random(self, number: int) -> bool:
        """Whether the scene of this proposal, which awaits its outcome, is a random one."""
        return number in self._open

    def learn(self, number: int, *, failed: bool) -> bool:
        """Learn the outcome of a scene that was rolled out; returns whether the scene was new."""
        drawn = self._open.pop(number, None)
        if drawn is None:
            return True
        self._judged[number] = replace(drawn, draw=replace(drawn.draw, failed=failed))
        self._rates.learn(explained=drawn.explained, failed=failed)
        return drawn.new

    def forget(self) -> None:
        """There is another reference: deviations from the old one are of no use."""
        self._deviations = self._ends = None

    @property
    def sample(self) -> list[int]:
        """The numbers of the draws that passed or failed, and are a random sample of scenes."""
        return sorted(number for number, drawn in self._judged.items() if drawn.sample)

    @property
    def elsewhere(self) -> float:
        """The failure rate of random scenes that no rule explains."""
        return self._rates.predict(0.0)

    def probability(self, *, over: bool) -> Probability:
        """The probability that the policy fails in a random scene; ``over``: see ``failure_probability``."""
        judged = [drawn.draw for drawn in self._judged.values()]
        return failure_probability([*judged, *self._left_out] if judged else [], over=over)

    def shares(self, rules: Rules, units: Units) -> list[Probability]:
        """The shares of random scenes that are in each rule's range and fail; a scene in several is shared out.

        Each is the probability of the range, from random scenes without a rollout, times the failure rate of the draws
        in it.
        """
        if not rules:
            return []
        parts, drawn = shared_out(rules.regions(self._random(units), units)), list(self._judged.values())
        levels = np.array([one.levels for one in drawn] or [units.reference])
        weights = np.array([1 / one.draw.chance for one in drawn] or [0.0])
        failed = np.array([bool(one.draw.failed) for one in drawn] or [False])
        inside = shared_out(rules.regions(units.deviations(levels), units)) * weights[:, None]
        return [share_of_range(*pair, failed) for pair in zip(parts.T, inside.T, strict=True)]

    def _random(self, units: Units) -> Array:
        """``(n, units + 1)`` deviations of the random scenes without a rollout."""
        self._keep(self._wanted, units)
        known = 0 if self._deviations is None else len(self._deviations)
        if known < len(self._supply):
            new = units.deviations(np.array(self._supply[known:]))
            self._deviations = new if self._deviations is None else np.concatenate([self._deviations, new])
        assert self._deviations is not None
        return self._deviations

    def _keep(self, number: int, units: Units) -> None:
        """Have at least so many random scenes without a rollout, the same in every run of a seed."""
        for index in range(len(self._supply), number):
            rng = np.random.default_rng([self._seed, index, 1])
            self._supply.append(units.levels(self._proposals.sampled(rng)))

    def _sample(self, number: int) -> None:
        """Have at least so many scenes to draw, which do not depend on what else is proposed."""
        while len(self._coming) < number:
            rng = np.random.default_rng([self._seed, self._sampled, 2])
            self._coming.append((self._proposals.sampled(rng), float(rng.random())))
            self._sampled += 1

    def _severe(self, rng: np.random.Generator, units: Units, rules: Rules) -> Genome:
        """The reference with a few units at the ends of their ranges, preferably where no rule explains a failure."""
        severe = np.array([self._together(rng, units) for _ in range(SUPPLY)])
        worths = (1 - rules.explain(units.deviations(severe), units)) ** AVERSE + 1e-6
        taken = severe[rng.choice(SUPPLY, p=worths / worths.sum())]
        return self._proposals.first_new(lambda: units.genome(taken), rng)

    def _together(self, rng: np.random.Generator, units: Units) -> Levels:
        farthest, levels = self._farthest(units), units.reference.copy()
        varied = [column for column, ends in enumerate(farthest) if ends]
        kept = np.zeros(len(units.units), dtype=bool)
        for column in rng.permutation(varied)[:TOGETHER]:
            indices, kept[column] = list(units.units[column].indices), True
            levels[indices] = farthest[column][rng.integers(len(farthest[column]))][indices]
        return units.keep(levels, kept)

    def _farthest(self, units: Units) -> list[list[Levels]]:
        self._keep(FIRST, units)
        if self._ends is None:
            self._ends = units.ends(np.array(self._supply[:FIRST]))
        return self._ends


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A random scene that is rolled out.

    Attributes:
        explained: it was in a rule's range.
        sample: it would have been rolled out in either case.
        new: it was not proposed before.
    """

    draw: Draw
    levels: Levels
    explained: bool
    sample: bool
    new: bool
