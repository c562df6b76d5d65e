"""MAP-Elites: an archive keeps the best scene of every niche; new scenes are mutated from them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from ribs.archives import GridArchive

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import OneByOne
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

STAGES, SQUARES = 8, 16  # lost stages, at most; squares of the workspace for the target
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.1  # and after it: there may be failures elsewhere
CROSSED = 0.3  # share of children with two parents
AGAIN = 0.4  # chance that a mutation changes one more operator
PASSING = -1.0  # objective at or below which a scene passed, see Score.ease

Rng = np.random.Generator


class MapElites(OneByOne):
    """Mouret, Clune 2015 <https://arxiv.org/abs/1504.04909>, with the archive of pyribs.

    A niche is a lost stage (or none), the operator farthest from nominal, and the target's square in the
    4 × 4 grid. Each keeps the scene that fails earliest, or passes latest. Parents are the failing elites;
    all elites while none fails.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._variation = Variation(space.genes)
        operators = len({gene.operator for gene in space.genes})
        dims = (STAGES, operators + 1, SQUARES)
        self._numbers: list[dict[str, int]] = [{} for _ in dims]
        self._archive = GridArchive(
            solution_dim=space.dim, dims=dims, ranges=[(-0.5, size - 0.5) for size in dims], seed=0
        )

    def ask(self, n: int) -> list[Proposal]:
        """Random scenes to begin with, then mostly children of elites."""
        self._elites, self._share = self._parents()
        return super().ask(n)

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

    def _parents(self) -> tuple[NDArray[np.float64], float]:
        """``(n, dim)`` elites to choose parents from, and the share of random scenes."""
        elites, objectives = (np.asarray(self._archive.data(field)) for field in ("solution", "objective"))
        failing = elites[objectives > PASSING]
        if len(failing):
            return failing, GUIDED
        return elites, BLIND if len(set(objectives)) > 1 else 1.0

    def _genome(self, number: int, rng: Rng) -> Genome:
        if len(self._elites) and rng.random() >= self._share:
            return self._proposals.first_new(lambda: self._child(rng), rng)
        return self._proposals.fresh(rng)

    def _child(self, rng: Rng) -> Genome:
        genome, other = self._elites[rng.integers(len(self._elites), size=2)]
        if rng.random() < CROSSED:
            genome = self._variation.cross(genome, other, rng)
        return self._variation.mutate_some(genome, AGAIN, rng)
