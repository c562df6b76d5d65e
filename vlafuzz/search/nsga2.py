"""NSGA-II: it evolves scenes toward early failures, near nominal and unlike known ones."""

from collections.abc import Sequence
from itertools import compress
from typing import Any

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import Archive, ProposalFactory, Rng
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

GENERATIONS, FEWEST = 15, 10  # in a run: at least, and at least with a small budget
TINIEST, SMALLEST, LARGEST = 4, 8, 64  # population sizes; below 8 only with a small budget
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.1  # and after it: there may be failures elsewhere
CROSSED = 0.7  # share of children with two parents
CHANGES = 1.5  # mean number of operators that a mutation changes
TRIES = 10  # rounds of mating without a new scene before random ones are proposed instead
MOST_SEVERE = 100.0  # above any severity


class Nsga2:
    """Evolves scenes toward early failures, near nominal and unlike known ones.

    Deb, Pratap, Agarwal, Meyarivan 2002 <https://doi.org/10.1109/4235.996017>, with pymoo's survival. Failures are
    ranked by progress, severity and novelty among the failures; every failure dominates every pass. Each batch competes
    with the population at once, so batches may have any size. Children are repaired, and not proposed twice unless the
    space is exhausted.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        from pymoo.core.population import Population  # which takes half a second to import

        self._space, self._seed, self._asked = space, seed, 0
        rollouts = budget or 10**9
        self._size = min(max(rollouts // GENERATIONS, SMALLEST), max(rollouts // FEWEST, TINIEST), LARGEST)
        self.about = f"population of {self._size}"
        if budget is not None:
            self.about += f", {budget // self._size} generations"
        self._proposals, self._failures = ProposalFactory(space), Archive()
        self._variation = Variation(space.genes)
        self._population = Population()

    def ask(self, n: int) -> list[Proposal]:
        """Random scenes to begin with, then mostly children of the best."""
        first, self._asked = self._asked, self._asked + n
        rngs = {number: np.random.default_rng([self._seed, number]) for number in range(first, self._asked)}
        share = self._share_of_fresh()
        bred = {number for number, rng in rngs.items() if number >= self._size and rng.random() >= share}
        children = iter(self._children(len(bred), np.random.default_rng([self._seed, first, 1])))
        proposals = []
        for number, rng in rngs.items():
            child = next(children, None) if number in bred else None
            genome = self._proposals.fresh(rng) if child is None else self._proposals.registered(child)
            proposals.append(Proposal(number, genome))
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Let the batch compete with the population; before there is one, all of it is."""
        if not proposals:
            return
        from pymoo.core.population import Population
        from pymoo.core.problem import Problem
        from pymoo.operators.survival.rank_and_crowding import RankAndCrowding

        size = self._size if len(self._population) else len(proposals)
        batch = Population.new("X", np.array([proposal.genome for proposal in proposals]))
        for individual, score in zip(batch, scores, strict=True):
            point = self._space.embed(self._space.decode(individual.X))
            individual.set("point", point)
            individual.set("score", score)
            if score.failed:
                self._failures.add(point)
        for part in (batch, self._population):  # all, as novelty changes with the archive
            self._judge(part)
        problem = Problem(n_var=self._space.dim, n_obj=3, n_ieq_constr=1)
        merged, rng = Population.merge(self._population, batch), np.random.default_rng([self._seed, proposals[0].id, 2])
        self._population = RankAndCrowding().do(problem, merged, n_survive=size, random_state=rng)

    def _share_of_fresh(self) -> float:
        """1 while all scores are equal."""
        if len(self._failures):
            return GUIDED
        known = self._population.get("score") if len(self._population) else ()
        return BLIND if len({score.ease for score in known if score.rolled_out}) > 1 else 1.0

    def _judge(self, population: Any) -> None:
        """Set objectives and constraint: invalid scenes rank behind all others."""
        if not len(population):
            return
        scores: list[Score] = list(population.get("score"))
        pairs = zip(scores, self._failures.novelty(population.get("point")), strict=True)
        population.set("F", np.array([self._objectives(*pair) for pair in pairs]))
        population.set("G", np.array([[0.0 if score.rolled_out else 1.0] for score in scores]))

    def _children(self, n: int, rng: Rng) -> list[Genome]:
        """Up to ``n`` new children; fewer if mating finds hardly any."""
        children: list[Genome] = []
        known = [individual.X for individual in self._population]
        for _ in range(TRIES):
            if len(children) == n:
                break
            bred = self._bred(n - len(children), rng)
            children += compress(bred, self._proposals.new(bred, [*known, *children]))
        return children

    def _bred(self, n: int, rng: Rng) -> list[Genome]:
        """Fair children of parents that won a binary tournament, crossed or not, all mutated."""
        among = len(self._population)
        drawn = np.concatenate([rng.permutation(among) for _ in range(-(-4 * n // among))])[: 4 * n]
        won = [self._winner(a, b, rng) for a, b in drawn.reshape(-1, 2).tolist()]
        pairs = [(self._population[a].X, self._population[b].X) for a, b in zip(won[::2], won[1::2], strict=True)]
        crossed = rng.random(n) < CROSSED
        children = [mother for mother, _ in pairs]
        if crossed.any():
            children = [self._variation.cross(*pair, rng) for pair in pairs]
        for index in np.flatnonzero(~crossed):
            children[index] = pairs[index][rng.choice(2, size=1, replace=False)[0]]
        children = [self._mutated(child, rng) for child in children]
        rng.random(n)  # as pymoo drew for every mutation, so that runs stay what they were
        return [self._proposals.fair(child, rng) for child in children]

    def _winner(self, a: int, b: int, rng: Rng) -> int:
        """Choose the better of two: the valid one, else the dominating one, else the less crowded one."""
        one, other = self._population[a], self._population[b]
        merits = [(other.CV[0], one.CV[0])]
        if max(merits[0]) == 0:
            dominates = bool((one.F <= other.F).all() and (one.F < other.F).any())
            dominated = bool((one.F >= other.F).all() and (one.F > other.F).any())
            merits = [(dominates, dominated), (one.get("crowding"), other.get("crowding"))]
        for ours, theirs in merits:
            if ours != theirs:
                return a if ours > theirs else b
        return int(rng.choice([a, b]))

    def _mutated(self, genome: Genome, rng: Rng) -> Genome:
        operators = self._variation.operators(genome)
        chosen = rng.random(len(operators)) < CHANGES / len(operators)
        chosen[rng.integers(len(operators))] = True
        return self._variation.mutate(genome, list(compress(operators, chosen)), rng)

    @staticmethod
    def _objectives(score: Score, novelty: float) -> tuple[float, float, float]:
        """The numbers to be minimized. Severity and novelty count for failures only."""
        if score.failed:
            return score.ease, score.severity, -novelty
        return (score.ease if score.rolled_out else 0.0), MOST_SEVERE, 0.0
