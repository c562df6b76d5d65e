"""Candidates: fair scenes that may be proposed, generated in advance and without a rollout."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Source
from vlafuzz.search.forest import Numbers
from vlafuzz.search.proposal_factory import ProposalFactory
from vlafuzz.search.variation import Variation

Rng = np.random.Generator

FRESH = 0.3  # share of the candidates drawn at random
CROSSED = 0.5  # share of the others with a random scene as second parent
AGAIN = 0.5  # chance that a mutation changes one more operator
PARENTS = 200  # the newest failures, and as many of the random scenes
HARDEST = 16  # passes that serve as parents before the first failure


@dataclass(frozen=True, eq=False)
class Candidate:
    """A scene as numbers.

    Attributes:
        features: input of the forest: embedding, genome and severities.
        site: the part of its cell that is known before a rollout.
        severity: distance from nominal, summed over the operators.
    """

    genome: Genome
    features: Numbers
    site: str
    severity: float


class Breeder:
    """Generates candidates: random ones, and children of failures or of passes that nearly failed."""

    def __init__(self, space: Source, proposals: ProposalFactory) -> None:
        self._space, self._proposals = space, proposals
        self._variation = Variation(space.genes)
        self._failures: deque[Genome] = deque(maxlen=PARENTS)
        self._drawn: deque[Genome] = deque(maxlen=PARENTS)
        self._nearly: list[tuple[float, Genome]] = []

    def candidate(self, genome: Genome) -> Candidate:
        """Everything known about a genome without a rollout."""
        scene = self._space.decode(genome)
        severities = self._space.severities(scene)
        features = np.concatenate([self._space.embed(scene), genome, list(severities.values())])
        return Candidate(genome, features, self._space.site(scene, severities), sum(severities.values()))

    def learn(self, genome: Genome, score: Score) -> None:
        """Keep the genome if it may become a parent."""
        if score.failed:
            self._failures.append(genome)
        else:
            self._nearly = sorted([*self._nearly, (score.ease, genome)], key=lambda pair: pair[0])[:HARDEST]

    def breed(self, n: int, rng: Rng) -> list[Candidate]:
        """Up to ``n`` new candidates that pass the static checks, none proposed before."""
        genomes = [self._fresh(rng) if rng.random() < FRESH else self._child(rng) for _ in range(n)]
        new = self._proposals.new(genomes)
        return [self.candidate(genome) for genome, is_new in zip(genomes, new, strict=True) if is_new]

    def _fresh(self, rng: Rng) -> Genome:
        self._drawn.append(self._space.nearest(self._space.sample(rng)))
        return self._drawn[-1]

    def _child(self, rng: Rng) -> Genome:
        """A parent with few operators changed, or crossed with a random scene."""
        parents = self._failures or [genome for _, genome in self._nearly]
        if not parents or not self._drawn:
            return self._fresh(rng)
        parent = parents[rng.integers(len(parents))]
        if rng.random() < CROSSED:
            other = self._drawn[rng.integers(len(self._drawn))]
            return self._proposals.fair(self._variation.cross(parent, other, rng), rng)
        operators = self._variation.operators(parent)
        count = min(int(rng.geometric(1 - AGAIN)), len(operators))
        chosen = rng.choice(operators, count, replace=False).tolist()
        return self._proposals.fair(self._variation.mutate(parent, chosen, rng), rng)
