"""MAP-Elites: an archive keeps the best scene of every niche; new scenes are mutated from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from ribs.archives import GridArchive

from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposal_factory import ProposalFactory
from vlafuzz.search.variation import Variation

STAGES, SQUARES = 8, 16  # lost stages, at most; squares of the workspace for the target
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.1  # and after it: there may be failures elsewhere
CROSSED = 0.3  # share of children with two parents
AGAIN = 0.4  # chance that a mutation changes one more operator
TRIES = 10  # known children before a random scene is proposed instead
PASSING = -1.0  # objective at or below which a scene passed, see Score.ease

Rng = np.random.Generator
Genomes = NDArray[np.float64]  # (n, dim)


class MapElites:
    """Mouret, Clune 2015 <https://arxiv.org/abs/1504.04909>, with the archive of pyribs.

    A niche is a lost stage (or none), the operator farthest from nominal, and the target's square in the
    4 × 4 grid. Each keeps the scene that fails earliest, or passes latest. Parents are drawn uniformly from
    the failing elites; from all elites while none fails.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        self._space, self._seed, self._asked = space, seed, 0
        self._proposals, self._variation = ProposalFactory(space), Variation(space.genes)
        operators = len({gene.operator for gene in space.genes})
        dims = (STAGES, operators + 1, SQUARES)
        self._numbers: list[dict[str, int]] = [{} for _ in dims]
        self._archive = GridArchive(
            solution_dim=space.dim, dims=dims, ranges=[(-0.5, size - 0.5) for size in dims], seed=0
        )

    def ask(self, n: int) -> list[Proposal]:
        """Random scenes to begin with, then mostly children of elites."""
        first, self._asked = self._asked, self._asked + n
        parents, share = self._parents()
        return [self._proposal(number, parents, share) for number in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Let every scene that was rolled out compete for its niche."""
        judged = [pair for pair in zip(proposals, scores, strict=True) if pair[1].rolled_out]
        if judged:
            self._archive.add(
                np.array([proposal.genome for proposal, _ in judged]),
                np.array([-score.ease for _, score in judged]),
                np.array([self._niche(proposal.genome, score) for proposal, score in judged]),
            )

    def _niche(self, genome: Genome, score: Score) -> list[int]:
        """The niche's coordinates: names are numbered in order of first occurrence."""
        scene = self._space.decode(genome)
        severities = self._space.severities(scene)
        farthest = max(severities, key=lambda name: severities[name])
        square = self._space.site(scene, severities).rpartition("|")[2]
        lost = (score.cell or "none").partition("|")[0]
        names = (lost, farthest if severities[farthest] > 0 else "base", square)
        return [known.setdefault(name, len(known)) for known, name in zip(self._numbers, names, strict=True)]

    def _parents(self) -> tuple[Genomes, float]:
        """``(n, dim)`` elites to choose parents from, and the share of random scenes."""
        elites, objectives = (np.asarray(self._archive.data(field)) for field in ("solution", "objective"))
        failing = elites[objectives > PASSING]
        if len(failing):
            return failing, GUIDED
        return elites, BLIND if len(set(objectives)) > 1 else 1.0

    def _proposal(self, number: int, parents: Genomes, share: float) -> Proposal:
        rng = np.random.default_rng([self._seed, number])
        if len(parents) and rng.random() >= share:
            for _ in range(TRIES):
                child = self._proposals.fair(self._child(parents, rng), rng)
                if self._proposals.new([child])[0]:
                    return Proposal(number, self._proposals.registered(child))
        return Proposal(number, self._proposals.fresh(rng))

    def _child(self, parents: Genomes, rng: Rng) -> Genome:
        genome, other = parents[rng.integers(len(parents), size=2)]
        if rng.random() < CROSSED:
            genome = self._variation.cross(genome, other, rng)
        operators = self._variation.operators(genome)
        count = min(int(rng.geometric(1 - AGAIN)), len(operators))
        return self._variation.mutate(genome, rng.choice(operators, count, replace=False).tolist(), rng)
