"""NSGA-II and NSGA-II-D: they evolve scenes toward early failures, near nominal and unlike known ones."""

from collections.abc import Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.crossover import Crossover
from pymoo.core.duplicate import DuplicateElimination
from pymoo.core.mutation import Mutation
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.repair import Repair
from pymoo.core.termination import NoTermination

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import Archive, ProposalFactory
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
LEAVES = 0.5  # share of a population replaced by random scenes when it stalls: NSGA-II-D

Rng = np.random.Generator
Genomes = NDArray[np.float64]  # (n, dim)


class Nsga2:
    """Deb, Pratap, Agarwal, Meyarivan 2002 <https://doi.org/10.1109/4235.996017>, with pymoo's selection.

    Failures are ranked by progress, severity and novelty among the failures; every failure dominates every
    pass. Each batch competes with the population at once, so batches may have any size. Children are
    repaired, and not proposed twice unless the space is exhausted.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        self._space, self._seed, self._asked = space, seed, 0
        rollouts = budget or 10**9
        self._size = min(max(rollouts // GENERATIONS, SMALLEST), max(rollouts // FEWEST, TINIEST), LARGEST)
        self.about = f"population of {self._size}"
        if budget is not None:
            self.about += f", {budget // self._size} generations"
        self._proposals, self._failures = ProposalFactory(space), Archive()
        variation = Variation(space.genes)
        self._algorithm = NSGA2(
            pop_size=self._size,
            sampling=None,
            crossover=_Crossing(variation),
            mutation=_Mutating(variation),
            repair=_Repairing(self._proposals),
            eliminate_duplicates=_OnlyNew(self._proposals),
        )
        problem = Problem(n_var=space.dim, n_obj=3, n_ieq_constr=1, xl=0.0, xu=1.0)
        self._algorithm.setup(problem, seed=seed)
        self._algorithm.termination = NoTermination()
        self._algorithm.mating.n_max_iterations = TRIES

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
        """Let the batch compete with the population."""
        if not proposals:
            return
        population = Population.new("X", np.array([proposal.genome for proposal in proposals]))
        points = [self._space.embed(self._space.decode(proposal.genome)) for proposal in proposals]
        for individual, point, score in zip(population, points, scores, strict=True):
            individual.set("point", point)
            individual.set("score", score)
            if score.failed:
                self._failures.add(point)
        self._judge(population)
        if self._algorithm.is_initialized:
            self._judge(self._algorithm.pop)  # novelty changes with the archive
        self._algorithm.random_state = np.random.default_rng([self._seed, proposals[0].id, 2])
        self._algorithm.tell(infills=population)

    def _share_of_fresh(self) -> float:
        """1 while all scores are equal."""
        if len(self._failures):
            return GUIDED
        known = self._algorithm.pop.get("score") if self._algorithm.is_initialized else ()
        return BLIND if len({score.ease for score in known if score.rolled_out}) > 1 else 1.0

    def _children(self, n: int, rng: Rng) -> Sequence[Genome]:
        if n == 0:
            return []
        self._algorithm.random_state, self._algorithm.n_offsprings = rng, n
        children = self._algorithm.ask()
        self._algorithm.termination.force_termination = False  # set when mating found no new children
        return [] if children is None else list(children.get("X"))

    def _judge(self, population: Any) -> None:
        """Set objectives and constraint: invalid scenes rank behind all others."""
        scores: list[Score] = list(population.get("score"))
        novelty = self._failures.novelty(population.get("point"))
        population.set("F", np.array([self._objectives(*pair) for pair in zip(scores, novelty, strict=True)]))
        population.set("G", np.array([[0.0 if score.rolled_out else 1.0] for score in scores]))

    @staticmethod
    def _objectives(score: Score, novelty: float) -> tuple[float, float, float]:
        """To be minimized. Severity and novelty count for failures only."""
        if score.failed:
            return score.ease, score.severity, -novelty
        return (score.ease if score.rolled_out else 0.0), MOST_SEVERE, 0.0


class Nsga2D(Nsga2):
    """NSGA-II-D: Sorokin, Safin, Nejati 2024 <https://doi.org/10.1007/s10664-024-10599-9>.

    Every scene, failing or not, is ranked by progress, severity and its distance from known failures: an
    archive of failures repels the population. When a whole generation reaches no new cell, random scenes
    replace the worse half of the population.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed, budget)
        self._cells: set[str] = set()
        self._stalled = self._vacant = 0

    def ask(self, n: int) -> list[Proposal]:
        """As NSGA-II, after random scenes for the vacant places."""
        proposals = super().ask(n)
        self._vacant = max(self._vacant - n, 0)
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Let the batch compete, and repopulate when it stalls."""
        super().tell(proposals, scores)
        reached = {score.cell for score in scores if score.failed and score.cell} - self._cells
        self._cells |= reached
        self._stalled = 0 if reached or not self._cells else self._stalled + len(proposals)
        if self._stalled >= self._size:
            self._repopulate()

    def _repopulate(self) -> None:
        """Keep the better half of the population."""
        stay = max(round((1 - LEAVES) * self._size), 1)
        algorithm, rng = self._algorithm, np.random.default_rng([self._seed, self._asked, 3])
        algorithm.pop = algorithm.survival.do(
            algorithm.problem, algorithm.pop, n_survive=stay, algorithm=algorithm, random_state=rng
        )
        self._vacant, self._stalled = self._size - stay, 0

    def _share_of_fresh(self) -> float:
        return 1.0 if self._vacant else super()._share_of_fresh()

    @staticmethod
    def _objectives(score: Score, novelty: float) -> tuple[float, float, float]:
        """To be minimized. Invalid scenes rank behind all others by their constraint."""
        return (score.ease, score.severity, -novelty) if score.rolled_out else (0.0, MOST_SEVERE, 0.0)


class _Crossing(Crossover):
    def __init__(self, variation: Variation) -> None:
        super().__init__(n_parents=2, n_offsprings=1, prob=CROSSED)
        self._variation = variation

    def _do(self, _: Problem, parents: Genomes, *, random_state: Rng, **__: Any) -> Genomes:
        """``(2, n, dim)`` parents to ``(1, n, dim)`` children."""
        pairs = zip(*parents, strict=True)
        return np.array([[self._variation.cross(mother, father, random_state) for mother, father in pairs]])


class _Mutating(Mutation):
    def __init__(self, variation: Variation) -> None:
        super().__init__(prob=1.0)
        self._variation = variation

    def _do(self, _: Problem, genomes: Genomes, *, random_state: Rng, **__: Any) -> Genomes:
        mutants = []
        for genome in genomes:
            operators = self._variation.operators(genome)
            chosen = random_state.random(len(operators)) < CHANGES / len(operators)
            chosen[random_state.integers(len(operators))] = True
            mutants.append(self._variation.mutate(genome, list(compress(operators, chosen)), random_state))
        return np.array(mutants)


class _Repairing(Repair):
    def __init__(self, proposals: ProposalFactory) -> None:
        super().__init__()
        self._proposals = proposals

    def _do(self, _: Problem, genomes: Genomes, *, random_state: Rng, **__: Any) -> Genomes:
        return np.array([self._proposals.fair(genome, random_state) for genome in genomes])


class _OnlyNew(DuplicateElimination):
    def __init__(self, proposals: ProposalFactory) -> None:
        super().__init__()
        self._proposals = proposals

    def do(self, pop: Any, *others: Any, **_: Any) -> Any:
        earlier = [individual.X for other in others for individual in other]
        return pop[self._proposals.new([individual.X for individual in pop], earlier)]
