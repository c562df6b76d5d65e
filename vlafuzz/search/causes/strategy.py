"""Causes: attributes failures as they come, and then looks where nothing is explained yet."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.scoring import Score
from vlafuzz.search.base import Cause, Genome, Proposal, Source
from vlafuzz.search.causes.rules import Rule
from vlafuzz.search.causes.suspects import FIRM, RATE_PRIOR, RATES, Mask, Suspects
from vlafuzz.search.causes.units import Levels, Numbers, Units
from vlafuzz.search.proposals import ProposalFactory

SURE = 0.9  # probability of a set of units that ends an attribution
TESTS = {True: (12, 30), False: (22, 45)}  # of an attribution: after so many units are removed one by one
AT_ONCE = 3  # attributions at a time
PROBES = 2
KNOWN = 0.85
POSSIBLE = 0.12
CATEGORY, LEAST = 0.5, 0.15  # severity of a category, and of the smallest number
LARGEST = 4  # units of a cause
SUPPLY = 4
FLOOR = 0.08
MEMORY = 400
REPEATS = 6  # of the first failures as they are: they show how often a fault makes the policy fail
DRAWS_AT_ONCE = 4


@dataclass(eq=False)
class Attribution:
    levels: Levels
    deviations: Numbers
    suspects: Suspects
    waiting: bool = False


@dataclass(frozen=True, eq=False)
class Test:
    kept: Mask
    attribution: Attribution | None = None
    rule: Rule | None = None
    original: Levels | None = None
    failure: bool = False  # whether the rule may explain a failure


class Causes:
    def __init__(
        self,
        space: Source,
        seed: int,
        budget: int | None = None,
        *,
        first: float = 0.0,
        explain: bool = True,
        avoid: bool = True,
        stretch: float = 0.5,
        floor: float = 0.08,
    ) -> None:
        self._stretch, self._floor, self._recent = stretch, floor, deque[bool](maxlen=30)
        self._space, self._seed, self._asked, self._round = space, seed, 0, 0
        self._first = first * (budget or 0)  # random scenes before anything is attributed
        self._explains, self._avoids = explain, avoid
        self._proposals = ProposalFactory(space)
        reference = np.array([gene.grid.nominal_level for gene in space.genes], dtype=np.int64)
        self._units = Units(space.genes, reference)
        self.rules: list[Rule] = []
        self.unexplained: list[Levels] = []
        self._pending: deque[Levels] = deque()
        self._active: list[Attribution] = []
        self._queue: deque[Test] = deque()
        self._out: dict[int, Test | None] = {}
        self._known: deque[tuple[Numbers, bool, float]] = deque(maxlen=MEMORY)
        self._rates, self._repeats = RATE_PRIOR, REPEATS

    # -- proposals

    def ask(self, n: int) -> list[Proposal]:
        self._round += 1
        rng = np.random.default_rng([self._seed, self._asked])
        if self._asked >= self._first:
            self._begin()
        proposals: list[Proposal] = []
        while len(proposals) < n:
            made = self._test(rng) or (self._draw(rng) if self._may_draw(len(proposals)) else None)
            if made is None:
                break
            test, genome = made
            number = self._asked
            self._asked += 1
            self._out[number] = test
            proposals.append(Proposal(number, genome))
        return proposals

    def _may_draw(self, already: int) -> bool:
        if self._asked < self._first:
            return True
        return not already or (not self._pending and len(self._active) < AT_ONCE)

    def _begin(self) -> None:
        while self._pending and len(self._active) < AT_ONCE:
            levels = self._pending.popleft()
            if any(np.array_equal(levels, other.levels) for other in self._active):
                continue
            if self._explain(levels):
                continue
            self._active.append(self._attribution(levels))

    def _attribution(self, levels: Levels) -> Attribution:
        deviations = self._units.deviations(levels[None])[0]
        here = np.abs(deviations[:-1])
        severity = np.where(here == 0, 0.0, np.where(here > 1, CATEGORY, np.minimum(LEAST + here, 1.0)))
        suspects = Suspects(severity, self._rates)
        if self._known:
            scenes, failed, otherwise = map(np.array, zip(*self._known, strict=True))
            suspects.learn_scenes(self._units.alike(scenes, deviations), failed, otherwise)
        return Attribution(levels, deviations, suspects)

    def _explain(self, levels: Levels) -> bool:
        """Whether a rule surely explains a failure, or may and is to be tried first."""
        deviations = self._units.deviations(levels[None])
        chances = [float(rule.chance(deviations, self._units)[0]) for rule in self.rules]
        if not chances or not self._explains:
            return False
        rule = self.rules[int(np.argmax(chances))]
        if max(chances) >= KNOWN:
            rule.hits += 1
            return True
        if max(chances) >= POSSIBLE:
            self._queue.append(Test(rule.kept, rule=rule, original=levels, failure=True))
            return True
        return False

    def _test(self, rng: np.random.Generator) -> tuple[Test, Genome] | None:
        while self._queue:
            test = self._queue.popleft()
            assert test.original is not None
            genome = self._fair(self._units.keep(test.original, test.kept), rng)
            if genome is not None:
                return test, genome
            if test.failure:
                self._retry(test)
        for attribution in list(self._active):
            if attribution.waiting:
                continue
            while attribution in self._active:
                kept = self._next_test(attribution, rng)
                if kept is None:
                    break
                genome = self._fair(self._units.keep(attribution.levels, kept), rng)
                if genome is not None:
                    attribution.waiting = True
                    return Test(kept, attribution), genome
                attribution.suspects.rule_out(kept)
        return None

    def _next_test(self, attribution: Attribution, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the next test; None once the attribution has ended."""
        suspects = attribution.suspects
        if self._repeats:
            self._repeats -= 1
            return suspects.deviating
        few, most = TESTS[suspects.rate > FIRM]
        kept = suspects.next_test(rng) if suspects.tests < few else None
        if kept is None:
            kept = suspects.without_one() if suspects.tests < most else None
            if kept is None and suspects.tests < most and suspects.smallest.sum() <= LARGEST:
                self._establish(suspects.smallest, attribution)
            elif kept is None:
                self._give_up(attribution)
        return kept

    def _retry(self, test: Test) -> None:
        """A rule did not explain a failure after all: other rules are not asked again."""
        assert test.original is not None
        self._active.append(self._attribution(test.original))

    def _fair(self, levels: Levels, rng: np.random.Generator) -> Genome | None:
        """The genome of a scene that is fair as it is; if it is known, of one beside it."""
        for _ in range(6):
            scene = self._space.decode(self._units.genome(levels))
            genome = self._space.nearest(scene)
            repaired = self._space.repaired(scene, np.random.default_rng(0))
            if repaired is None or repaired.digest != scene.digest:
                return None
            if self._proposals.new([genome])[0]:
                return self._proposals.registered(genome)
            levels = self._units.jittered(levels, rng)
        return None

    def _draw(self, rng: np.random.Generator) -> tuple[None, Genome]:
        stretched = self._avoids and rng.random() < self._stretch * self._quiet()
        genomes = [self._candidate(rng, stretched) for _ in range(SUPPLY if self._avoids else 1)]
        if len(genomes) == 1:
            return None, self._proposals.registered(genomes[0])
        deviations = self._units.deviations(np.array([self._units.levels(genome) for genome in genomes]))
        weights = 1 - self._explained(deviations)
        weights = np.maximum(weights, self._floor)
        index = int(rng.choice(len(genomes), p=weights / weights.sum()))
        return None, self._proposals.registered(genomes[index])

    def _candidate(self, rng: np.random.Generator, stretched: bool) -> Genome:
        genome = self._proposals.drawn(rng)
        if not stretched:
            return genome
        return self._proposals.fair(self._units.genome(self._units.stretched(self._units.levels(genome), rng)), rng)

    def _quiet(self) -> float:
        """How rare unexplained failures have been of late, in [0, 1]."""
        return max(0.0, 1 - 3 * float(np.mean(self._recent))) if self._recent else 1.0

    def _explained(self, deviations: Numbers) -> Numbers:
        left = np.ones(len(deviations))
        for rule in self.rules:
            left *= 1 - rule.chance(deviations, self._units)
        return 1 - left

    # -- outcomes

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        for proposal, score in zip(proposals, scores, strict=True):
            test = self._out.pop(proposal.id)
            levels = self._units.levels(proposal.genome)
            if test is None:
                self._learn_draw(levels, score)
            elif test.attribution is not None:
                self._learn_test(test, score)
            else:
                self._learn_probe(test, levels, score)

    def _learn_draw(self, levels: Levels, score: Score) -> None:
        if not score.rolled_out:
            return
        deviations = self._units.deviations(levels[None])
        explained = float(self._explained(deviations)[0])
        self._known.append((deviations[0], score.failed, max(0.1, explained)))
        self._recent.append(score.failed and explained < 0.5)
        if score.failed:
            self._pending.append(levels)

    def _learn_test(self, test: Test, score: Score) -> None:
        attribution = test.attribution
        assert attribution is not None
        attribution.waiting = False
        if not score.rolled_out or attribution not in self._active:
            return
        if np.array_equal(test.kept, attribution.suspects.deviating):
            rates = self._rates * (RATES if score.failed else 1 - RATES)
            self._rates = rates / rates.sum()
        attribution.suspects.learn_test(test.kept, failed=score.failed)
        kept, chance, confirmed = attribution.suspects.best()
        if chance >= SURE and confirmed:
            self._establish(kept, attribution)

    def _establish(self, kept: Mask, attribution: Attribution) -> None:
        self._active.remove(attribution)
        levels = self._units.keep(attribution.levels, kept)
        deviations = self._units.deviations(levels[None])[0]
        rule = Rule.of(kept, levels, deviations, self._units)
        same = next((other for other in self.rules if other.same_kind(rule)), None)
        if same is not None:
            same.learn_failure(deviations, levels, self._units)
            rule = same
        else:
            self.rules.append(rule)
            self._probe(rule)
        for other in list(self._active):  # the same cause may be looked into twice
            if self._rule_chance(rule, other.levels) >= POSSIBLE and not other.waiting:
                self._active.remove(other)
                self._pending.appendleft(other.levels)

    def _rule_chance(self, rule: Rule, levels: Levels) -> float:
        return float(rule.chance(self._units.deviations(levels[None]), self._units)[0])

    def _probe(self, rule: Rule) -> None:
        """Ask how far towards the reference each number may go."""
        for index in np.flatnonzero(rule.kept):
            unit = self._units.units[index]
            if unit.kind != "number":
                continue
            for share in (0.5, 0.25)[: PROBES - 1]:
                gene = unit.indices[0]
                levels = rule.levels.copy()
                away = levels[gene] - self._units.reference[gene]
                levels[gene] -= round(away * share)
                if levels[gene] != rule.levels[gene]:
                    self._queue.append(Test(rule.kept, rule=rule, original=levels))

    def _learn_probe(self, test: Test, levels: Levels, score: Score) -> None:
        assert test.rule is not None
        assert test.original is not None
        deviations = self._units.deviations(levels[None])[0]
        if score.failed:
            test.rule.learn_failure(deviations, levels, self._units)
            return
        if score.rolled_out:
            test.rule.learn_pass(deviations)
        if test.failure:
            self._retry(test)

    def _give_up(self, attribution: Attribution) -> None:
        self._active.remove(attribution)
        self.unexplained.append(attribution.levels)

    # -- results

    def causes(self) -> list[Cause]:
        """The causes found so far, in the order in which they were found."""
        return [
            Cause(self._units.genome(rule.levels), self._units.operators(rule.kept), rule.hits)
            for rule in self.rules
        ]
