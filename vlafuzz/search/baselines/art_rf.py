"""Adaptive random testing with a random forest: scenes far from earlier ones and likely to fail."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from sklearn.ensemble import RandomForestClassifier

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import Archive, OneByOne, Points, Rng
from vlafuzz.search.scoring import Score

CANDIDATES = 10  # per proposal, the usual number for FSCS
FARTHEST = 5  # candidates, by distance, among which the forest chooses
TREES = 50
REMEMBERED = 800  # scenes in the training set
SOONEST, GROWTH = 16, 0.15  # new scenes before a refit: at least so many, and this share of all scenes


class ArtRf(OneByOne):
    """After FATE-VLA's description of its hybrid (Kanwal, Valle, Ali, Arrieta 2026, <https://arxiv.org/abs/2606.02307>).

    Fixed-size-candidate-set adaptive random testing (Chen, Leung, Mak 2004,
    <https://doi.org/10.1007/978-3-540-30502-6_23>): of ten random scenes the five farthest from all proposals are kept.
    Of these, a random forest trained on the outcomes chooses the likeliest failure; before it has seen both a failure
    and a pass, the farthest is taken.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._proposed = Archive()
        self._known: deque[tuple[Points, bool]] = deque(maxlen=REMEMBERED)
        self._forest: RandomForestClassifier | None = None
        self._fits = self._new = 0

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Learn the outcomes, and refit the forest from time to time."""
        for proposal, score in zip(proposals, scores, strict=True):
            if score.rolled_out:
                self._known.append((self._point(proposal.genome), score.failed))
                self._new += 1
        failed = [is_failure for _, is_failure in self._known]
        if self._new >= max(SOONEST, GROWTH * len(failed)) and 0 < sum(failed) < len(failed):
            state = int(np.random.default_rng([self._seed, self._fits]).integers(2**32))
            forest = RandomForestClassifier(TREES, min_samples_leaf=2, random_state=state)
            self._forest = forest.fit(np.array([point for point, _ in self._known]), failed)
            self._fits, self._new = self._fits + 1, 0

    def _genome(self, number: int, rng: Rng) -> Genome:
        genomes = [self._space.encode(self._space.sample(rng)) for _ in range(CANDIDATES)]
        genomes = [genome for genome, new in zip(genomes, self._proposals.new(genomes), strict=True) if new]
        if not genomes:
            return self._proposals.fresh(rng)
        points = np.array([self._point(genome) for genome in genomes])
        best = self._best(points)
        self._proposed.add(points[best])
        return self._proposals.registered(genomes[best])

    def _best(self, points: Points) -> int:
        """The index of the likeliest failure among the farthest."""
        farthest = np.argsort(-self._proposed.novelty(points, neighbours=1), kind="stable")[:FARTHEST]
        if self._forest is None:
            return int(farthest[0])
        return int(farthest[np.argmax(self._forest.predict_proba(points[farthest])[:, 1])])

    def _point(self, genome: Genome) -> Points:
        return self._space.embed(self._space.decode(genome))
