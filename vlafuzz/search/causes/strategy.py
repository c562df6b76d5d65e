"""Causes: attributes failures as they come, and then looks where no known cause explains a failure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vlafuzz.common.arrays import Mask
from vlafuzz.search.base import Cause, Genome, Proposal, Source
from vlafuzz.search.causes.attribution import LONGER, Attribution, Test
from vlafuzz.search.causes.background import Background
from vlafuzz.search.causes.draws import PLAIN, TOGETHER, Draws
from vlafuzz.search.causes.rules import KNOWN, Rule, Rules
from vlafuzz.search.causes.suspects import RATE_PRIOR, RATES, Ended, Suspects
from vlafuzz.search.causes.units import Levels, Units
from vlafuzz.search.causes.waiting import Waiting
from vlafuzz.search.probability import Probability
from vlafuzz.search.proposals import ProposalFactory
from vlafuzz.search.scoring import Score

LEAST_OUTSTANDING = 4  # proposals whose outcomes are awaited: they keep two to four workers busy
# A run learns from outcomes in so many rounds: with half as many, runs of 300 rollouts find a tenth fewer causes, and
# with 150, runs of 3,000 find as many.
ROUNDS = 115
TESTS = 20  # of an attribution: none begins that cannot be completed
POSSIBLE = 0.12  # chance from which a rule is tried on a failure
MEMORY = 400  # scenes that an attribution learns from
ELSEWHERE = 0.1  # least chance that a scene fails for a reason other than a suspected one
TRIALS = 3  # of a rule on a failure, at most: with 6, a run finds 5 % fewer causes at 20 % background
ALONE, SEVERE = 0.15, 0.3  # share of scenes with one unit at an end, and of severe ones, that fail for a cause
RATE_WORTH = 3  # causes that the prior of failure rates inside of causes is worth
# Likelihood ratio that tests of an answer have to show, times the square of the odds that one is refuted, as many of
# those are chances to be wrong; for a single unit, of which many are tried: with 100, two of 96 policies that only fail
# by chance got a cause, with 250 none; and its least logarithm.
CONFIRMED, CONFIRMED_ALONE, LEAST_CONFIRMED = 20.0, 250.0, 2.3
CONFIRMING = 4.0  # tests that an attribution takes beside one for each bit: with 10, as many causes are found
PASSES = 8  # of which the least severe becomes the reference, where the nominal scene fails
SURVIVES = 0.5  # prior that a predecessor's cause is one of this policy, too
NEARBY = 20  # known scenes beside which a new one is looked for


class Causes:
    """Spends the budget on distinct causes.

    A failure is attributed by scenes in which some units are reset to a reference, the nominal scene if the policy
    passes there; see ``Suspects``. What is found becomes a rule. A failure that a rule explains is not attributed,
    after one test if in doubt. The causes of a predecessor are tested first. Half of the proposals are random scenes.
    The others begin with each unit by itself at the ends of its range, where causes of one operator show. Then come
    failures of random scenes and of severe ones, which have a few units at such ends: the more often a policy fails by
    chance, the more of these.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None, *, like: Sequence[Cause] = ()) -> None:
        self._space, self._seed, self._asked, self._rolled_out = space, seed, 0, 0
        self._budget = budget
        self.outstanding = max(LEAST_OUTSTANDING, (budget or 0) // ROUNDS)
        self._proposals = ProposalFactory(space)
        self._units = Units(space.genes)
        self._draws = Draws(self._proposals, seed)
        found = ((self._units.levels(cause.genome), cause.operators) for cause in like)
        taken = ((levels, self._units.taken(levels, operators)) for levels, operators in found)
        self._inherited = deque((levels, kept) for levels, kept in taken if kept.any())
        self._background = Background()
        self._rules = Rules()
        self._waiting = Waiting()
        self._active: list[Attribution] = []
        self._tests: deque[Test] = deque()
        self._out: dict[int, tuple[Test | None, Genome]] = {}
        self._known: deque[tuple[Levels, str | None, float]] = deque(maxlen=MEMORY)  # with the stage that each lost
        self._lost: dict[bytes, str] = {}  # by failures
        self._rates = RATE_WORTH * RATE_PRIOR
        self._given_up: list[Levels] = []
        self._alone: deque[Levels] | None = None  # scenes with one unit at an end; None without a reference
        self._refuted = 0  # answers that did not hold when they were tested
        self._concluding = False

    def ask(self, n: int) -> list[Proposal]:
        """Up to ``n`` proposals: tests that are due, then draws unless there are failures to attribute."""
        rng = np.random.default_rng([self._seed, self._asked])
        proposals: list[Proposal] = []
        while len(proposals) < n:
            self._begin()
            due = self._draws.due(self._asked)
            test = self._nominal_test(rng) or (None if due else self._alone_test(rng) or self._next_test(rng))
            failures_wait = self._waiting.any_of_few or len(self._active) >= self._at_once()
            if proposals and failures_wait and not (test or due):  # one scene is always proposed
                break
            genome = test[1] if test else self._draws.draw(self._asked, rng, self._units, self._rules)
            self._out[self._asked] = test[0] if test else None, genome
            proposals.append(Proposal(self._asked, genome))
            self._asked += 1
        return proposals

    def ahead(self, n: int) -> list[Genome]:
        """The random scenes among the next ``n`` proposals, unless a cause that is found first explains one."""
        return self._draws.ahead(self._asked + n, self._units, self._rules)

    def conclude(self) -> None:
        """Attribute the failures that wait from now on, and draw severe scenes where none waits."""
        self._concluding = True
        self._draws.conclude()

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Learn from draws, and from tests for the attribution or the rule that they are for."""
        for proposal, score in zip(proposals, scores, strict=True):
            test, asked = self._out.pop(proposal.id)
            self._rolled_out += score.rolled_out
            levels = self._units.levels(proposal.genome)
            if test is not None and proposal.genome is not asked:  # without the events that had not begun
                self._miss(test)
                test = None
            if test is None:
                self._learn_draw(proposal.id, levels, score)
            elif test.attribution is not None:
                self._learn_test(test, test.attribution, score)
            elif test.rule is not None:
                self._learn_trial(test, test.rule, levels, score)
            elif score.rolled_out and test.alone:
                self._remember(levels, score)
                self._background.learn_alone(ALONE, failed=score.failed)
                if score.failed:
                    self._waiting.add(levels, few=True)
            elif score.rolled_out:
                self._background.learn(failed=score.failed)

    def causes(self) -> list[Cause]:
        """The causes found so far, in the order in which they were found."""
        return [
            Cause(self._units.genome(rule.levels), self._units.operators(rule.kept), rule.hits, share, rule.tests)
            for rule, share in zip(self._rules, self._draws.shares(self._rules, self._units), strict=True)
        ]

    @property
    def found(self) -> int:
        """The number of causes so far."""
        return len(self._rules)

    @property
    def unexplained(self) -> list[Genome]:
        """The failures for which no cause was found, or not yet."""
        out = [test for test, _ in self._out.values() if test]
        trials = [test.scene for test in (*self._tests, *out) if test.failure]
        open_ones = [attribution.levels for attribution in self._active if not attribution.inherited]
        return [self._units.genome(levels) for levels in (*self._given_up, *self._waiting, *open_ones, *trials)]

    @property
    def at_random(self) -> list[int]:
        """The ids of the proposals that are a random sample of scenes, which passed or failed."""
        return self._draws.sample

    def probability(self) -> Probability:
        """The probability that the policy fails in a random scene.

        Its interval holds at any time until the budget is spent, and then for this number of rollouts.
        """
        return self._draws.probability(over=self._budget is not None and self._rolled_out >= self._budget)

    def _at_once(self) -> int:
        """How many attributions there may be: one that awaits no outcome, and fewer at the end."""
        if self._budget is None or self._concluding:
            return sum(each.waiting for each in self._active) + 1
        left = (self._budget - self._asked) * (1 - PLAIN)
        takes = TESTS * (1 + LONGER * self._background.rate)
        return int(min(sum(each.waiting for each in self._active) + 1, max(2, left // takes)))

    def _nominal_test(self, rng: np.random.Generator) -> tuple[Test, Genome] | None:
        """The reference again, a few times: how often the policy fails there is the background."""
        if self._asked == 0 or not self._background.is_due(self._asked, self._budget):
            return None
        nothing = np.zeros(len(self._units.units), dtype=bool)
        genome = self._fair(self._units.jittered(self._units.reference, rng), rng)
        self._background.asked += 1
        return (Test(self._units.reference, nothing), genome) if genome is not None else None

    def _alone_test(self, rng: np.random.Generator) -> tuple[Test, Genome] | None:
        """The reference with a single unit at an end of its range: there most causes of one operator are seen."""
        while self._alone:
            levels = self._alone.popleft()
            kept = self._units.deviations(levels[None])[0][:-1] != 0
            genome = self._fair(levels, rng)
            if genome is not None:
                return Test(self._units.levels(genome), kept, alone=True), genome
        return None

    def _begin(self) -> None:
        """Test a predecessor's causes; then attribute failures that wait, unless a rule explains them."""
        while self._background.has_reference and self._inherited and len(self._active) < self._at_once():
            self._attribute(*self._inherited.popleft())
        if self._background.has_reference and self._alone is None:
            self._alone = deque(self._draws.alone(self._units, self._budget))
        while self._alone is not None and not self._alone and len(self._active) < self._at_once():
            levels = self._waiting.next(self._promise)
            if levels is None:
                return
            deviations = self._units.deviations(levels[None])[0]
            rule, chance = self._rules.likeliest(deviations, self._units)
            if rule is not None and chance >= KNOWN:
                rule.hits += 1
            elif rule is None or chance < POSSIBLE or self._waiting.tried(levels):
                self._attribute(levels)
            else:
                self._tests.append(Test(levels, rule.kept, rule=rule, failure=True, chance=chance))

    def _attribute(self, levels: Levels, answer: Mask | None = None) -> None:
        """Look for the cause of a failure; with ``answer`` whether a predecessor's cause is one here."""
        units = self._count(levels)
        if not units:
            self._given_up.append(levels)
            return
        suspects = self._suspects(levels, inherited=answer is not None)
        odds = (self._refuted + 1) / (len(self._rules) + 1)
        confirmed = max(LEAST_CONFIRMED, math.log((CONFIRMED_ALONE if units == 1 else CONFIRMED) * odds**2))
        about = levels, suspects, self._background
        self._active.append(Attribution(*about, confirmed=confirmed, answer=answer))

    def _count(self, levels: Levels) -> int:
        """In how many units a scene differs from the reference."""
        return int(np.count_nonzero(self._units.severity(self._units.deviations(levels[None])[0])))

    def _suspects(self, levels: Levels, *, inherited: bool = False) -> Suspects:
        """Says what may make a scene fail, by the scenes so far; ``inherited``: by a predecessor's cause alone."""
        deviations = self._units.deviations(levels[None])[0]
        severity = self._units.severity(deviations)
        units, by_chance = np.count_nonzero(severity), self._background.by_chance
        if units <= TOGETHER:
            by_chance = self._background.by_chance_of(ALONE if units == 1 else SEVERE)
        if inherited:
            by_chance = 1 - SURVIVES
        usual, lost = 1.0, self._lost.get(levels.tobytes())
        if lost is not None:
            usual, by_chance = self._background.usual(lost, by_chance)
        suspects = Suspects(severity, self._rates / self._rates.sum(), self._background.chances, by_chance, usual)
        if self._known and not inherited and units > 1:
            scenes, stages, otherwise = zip(*self._known, strict=True)
            alike = self._units.alike(self._units.deviations(np.array(scenes)), deviations)
            ended = [Ended.of(stage, lost) for stage in stages]
            suspects.learn_scenes(alike, ended, np.maximum(otherwise, self._draws.elsewhere))
        return suspects

    def _promise(self, levels: Levels) -> float:
        """How much attributing a failure promises: what takes no or few tests first, what a rule may explain last."""
        _, chance = self._rules.likeliest(self._units.deviations(levels[None])[0], self._units)
        if chance >= KNOWN or self._count(levels) < 2:
            return math.inf
        if chance >= POSSIBLE and not self._waiting.tried(levels):
            return -chance
        suspects = self._suspects(levels)
        return (1 - suspects.by_chance) / (suspects.entropy + CONFIRMING)

    def _next_test(self, rng: np.random.Generator) -> tuple[Test, Genome] | None:
        while self._tests:
            test = self._tests.popleft()
            genome = self._fair(self._units.keep(test.scene, test.kept), rng)
            if genome is not None:
                return test, genome
            self._miss(test)
        for attribution in list(self._active):
            if attribution.waiting or attribution not in self._active:  # the end of one may stop another
                continue
            while (kept := attribution.next_test(rng)) is not None:
                genome = self._fair(self._units.keep(attribution.levels, kept), rng)
                if genome is not None:
                    attribution.waiting = True
                    return Test(attribution.levels, kept, attribution), genome
                attribution.suspects.rule_out(kept)
            self._end(attribution)
        return None

    def _fair(self, levels: Levels, rng: np.random.Generator) -> Genome | None:
        """The genome of a scene if it is fair; of one beside it if it is known."""
        beside = levels
        for number in range(NEARBY):
            scene = self._space.decode(self._units.genome(beside))
            genome = self._space.nearest(scene)
            known = not self._proposals.new([genome])[0]
            if number == 0 or not known:  # as fairness takes longest
                repaired = self._space.repaired(scene, np.random.default_rng(0))
                fair = repaired is not None and repaired.digest == scene.digest
                if fair and not known:
                    return self._proposals.registered(genome)
                if number == 0 and not fair:
                    return None
            beside = self._units.jittered(levels if number % 2 else beside, rng)
        return None

    def _learn_draw(self, number: int, levels: Levels, score: Score) -> None:
        if number == 0 and score.rolled_out:
            self._background.learn(failed=score.failed)
        is_random = self._draws.is_random(number)
        if not score.rolled_out or number == 0 or not self._draws.learn(number, failed=score.failed):
            return
        explained = self._remember(levels, score)
        if is_random:
            self._background.learn_draw(1 - explained, failed=score.failed)
        if score.failed:
            self._waiting.add(levels, few=not is_random)
        elif not (self._background.has_reference or self._background.is_due(self._asked, self._budget)):
            self._refer()

    def _remember(self, levels: Levels, score: Score) -> float:
        """Keep a scene for attributions to come; returns the chance that a rule explains a failure there."""
        explained = float(self._rules.explain(self._units.deviations(levels[None]), self._units)[0])
        otherwise = 1 - (1 - explained) * (1 - self._background.rate)
        self._known.append((levels, score.lost, min(max(ELSEWHERE, otherwise), 0.98)))
        if score.lost is not None:
            self._lost[levels.tobytes()] = score.lost
            self._background.lost[score.lost] += 1 - explained
        return explained

    def _refer(self) -> None:
        """Take the least severe scene that passes as the reference, once there are enough."""
        passing = np.array([levels for levels, lost, _ in self._known if lost is None])
        if len(passing) >= PASSES:
            severities = [self._units.severity(one).sum() for one in self._units.deviations(passing)]
            self._units = Units(self._space.genes, passing[int(np.argmin(severities))])
            self._background = Background(has_reference=True)
            self._draws.forget()

    def _learn_test(self, test: Test, attribution: Attribution, score: Score) -> None:
        if not score.rolled_out:
            self._miss(test)
            return
        attribution.waiting = False
        attribution.learn(test.kept, Ended.of(score.lost, self._lost.get(attribution.levels.tobytes())))
        if not score.failed:
            self._remember(self._units.keep(test.scene, test.kept), score)

    def _miss(self, test: Test) -> None:
        if test.attribution is not None:
            test.attribution.waiting = False
            test.attribution.suspects.rule_out(test.kept)
        elif test.failure:
            self._waiting.not_explained(test.scene)

    def _learn_trial(self, test: Test, rule: Rule, levels: Levels, score: Score) -> None:
        """Learn whether a scene is in a rule's range; again until that is clear."""
        if not score.rolled_out:
            self._miss(test)
            return
        background = self._background.rate
        inside = background + (1 - background) * float(self._rates @ RATES) / float(self._rates.sum())
        odds = test.chance / max(1 - test.chance, 1e-6)
        odds *= inside / background if score.failed else (1 - inside) / (1 - background)
        chance = odds / (1 + odds)
        deviations = self._units.deviations(levels[None])[0]
        if chance >= KNOWN:
            rule.learn_failure(deviations)
            rule.hits += test.failure
        elif chance <= POSSIBLE:
            rule.learn_pass(deviations)
            self._miss(test)
        elif test.trial < TRIALS:
            self._tests.appendleft(replace(test, chance=chance, trial=test.trial + 1))
        else:
            self._miss(test)

    def _end(self, attribution: Attribution) -> None:
        """Make a rule of what an attribution has found."""
        self._active.remove(attribution)
        if attribution.cause is None or attribution.scene is None:
            if not attribution.inherited:
                self._refuted += attribution.answered
                self._given_up.append(attribution.levels)
            return
        self._rates = self._rates + attribution.suspects.rates
        levels = self._units.keep(attribution.levels, attribution.scene)
        deviations = self._units.deviations(levels[None])[0]
        new = Rule.of(attribution.cause, levels, deviations, self._units, attribution.tests(self._units))
        rule = self._rules.add(new, deviations, self._units)
        self._waiting.forget(lambda all_: rule.chance(self._units.deviations(all_), self._units) >= POSSIBLE)
        if rule is new:
            self._tests += [Test(halfway, rule.kept, rule=rule) for halfway in rule.halfway(self._units)]
        else:
            rule.hits += 1
        for other in [active for active in self._active if not active.waiting]:
            chance = rule.chance(self._units.deviations(other.levels[None]), self._units)[0]
            if chance >= POSSIBLE:  # the same cause was being looked into twice
                self._active.remove(other)
                if not other.inherited:
                    self._waiting.again(other.levels)
