"""MAP-Elites: an archive keeps the best scene of every niche; new scenes are mutated from them."""

from collections.abc import Sequence

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import OneByOne
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

STAGES, SQUARES = 8, 16  # niches by lost stage and by place: whatever comes later shares the last one
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.1  # and after it: there may be failures elsewhere
CROSSED = 0.3  # share of children with two parents
AGAIN = 0.4  # chance that a mutation changes one more operator

Rng = np.random.Generator


class MapElites(OneByOne):
    """Mouret, Clune 2015 <https://arxiv.org/abs/1504.04909>.

    A niche is a lost stage (or none), the operator farthest from nominal, and the target's square in the 4 × 4 grid.
    Each keeps the scene that fails earliest, or passes latest. Parents are the failing elites; all elites while none
    fails.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._variation = Variation(space.genes)
        self._numbers: list[dict[str, int]] = [{}, {}, {}]
        self._archive: dict[tuple[int, ...], tuple[float, Genome]] = {}  # ease and genome of every elite

    def ask(self, n: int) -> list[Proposal]:
        """Random scenes to begin with, then mostly children of elites."""
        self._elites, self._share = self._parents()
        return super().ask(n)

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Let every scene that was rolled out compete for its niche."""
        best: dict[tuple[int, ...], tuple[float, Genome]] = {}
        for proposal, score in zip(proposals, scores, strict=True):
            niche = self._niche(proposal.genome, score) if score.rolled_out else None
            if niche is not None and (niche not in best or score.ease < best[niche][0]):
                best[niche] = score.ease, proposal.genome
        for niche, elite in sorted(best.items(), key=lambda pair: pair[0]):
            if niche not in self._archive or elite[0] < self._archive[niche][0]:
                self._archive[niche] = elite

    def _niche(self, genome: Genome, score: Score) -> tuple[int, ...]:
        """The niche's coordinates: names are numbered in order of first occurrence."""
        scene = self._space.decode(genome)
        severities = self._space.severities(scene)
        farthest = max(severities, key=lambda name: severities[name])
        square = self._space.site(scene, severities).rpartition("|")[2]
        lost = (score.cell or "none").partition("|")[0]
        names = (lost, farthest if severities[farthest] > 0 else "base", square)
        numbered = zip(self._numbers, names, strict=True)
        stage, operator, place = (known.setdefault(name, len(known)) for known, name in numbered)
        return min(stage, STAGES - 1), operator, min(place, SQUARES - 1)

    def _parents(self) -> tuple[list[Genome], float]:
        """Elites to choose parents from, and the share of random scenes."""
        failing = [genome for ease, genome in self._archive.values() if ease < 1]
        if failing:
            return failing, GUIDED
        several = len({ease for ease, _ in self._archive.values()}) > 1
        return [genome for _, genome in self._archive.values()], BLIND if several else 1.0

    def _genome(self, number: int, rng: Rng) -> Genome:
        if len(self._elites) and rng.random() >= self._share:
            return self._proposals.first_new(lambda: self._child(rng), rng)
        return self._proposals.fresh(rng)

    def _child(self, rng: Rng) -> Genome:
        genome, other = (self._elites[index] for index in rng.integers(len(self._elites), size=2))
        if rng.random() < CROSSED:
            genome = self._variation.cross(genome, other, rng)
        return self._variation.mutate_some(genome, AGAIN, rng)
