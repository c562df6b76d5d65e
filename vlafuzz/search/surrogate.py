"""Surrogate: trees predict which scenes fail, and likely failures unlike the known ones are rolled out."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import OneByOne, Points, Rng
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

WARM = 16  # scenes that are rolled out before the first prediction: as many as a batch
GROWTH = 1.1  # the trees are fitted again when there are so many times as many scenes
TREES, LEAF, TRIED = 64, 2, 0.5  # number of trees, scenes in a leaf, share of the genes considered for a split
SUPPLY, KEPT = 8, 128  # candidates made for each proposal, and the best that are kept for the next ones
CROSSED = 0.5  # share of candidates that are a failure crossed with a random scene
BLIND, GUIDED = 0.5, 0.15  # share of random proposals before the first failure and after it: trees may mislead
LATE = 0.1  # hardness of a very late pass: little beside a failure's 1, but a hint before the first one
NEIGHBOURS = 3  # known failures to which a candidate's distance is taken
DIGITS = 6  # of a candidate's worth that count: the last bits of floats depend on the machine


class Surrogate(OneByOne):
    """Rolls out scenes that trees predict to fail and that are far from known failures.

    Extremely randomised trees (Geurts, Ernst, Wehenkel 2006 <https://doi.org/10.1007/s10994-006-6226-1>) regress the
    *hardness* of genomes: 1 for a failure, at most ``LATE`` for a pass, the more the later it succeeded. Candidates are
    random scenes, and failures crossed with random scenes. A candidate is worth its predicted hardness times its mean
    distance to the nearest failures; proposals without an outcome count as failures.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._variation = Variation(space.genes)
        self._known: list[tuple[Genome, float]] = []  # genomes and their hardness
        self._failures: list[Genome] = []
        self._pending: dict[int, Genome] = {}  # by the proposal's id
        self._stock = np.empty((0, space.dim))  # candidates
        self._trees: Any = None
        self._fitted = 0  # number of known scenes at the last fit

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Learn which scenes failed; fit the trees when there are enough new ones."""
        for proposal, score in zip(proposals, scores, strict=True):
            self._pending.pop(proposal.id, None)
            if score.rolled_out:
                self._known.append((proposal.genome, 1.0 if score.failed else LATE * (1 - score.slack)))
            if score.failed:
                self._failures.append(proposal.genome)
        if len(self._known) >= max(WARM, GROWTH * self._fitted):
            from sklearn.ensemble import ExtraTreesRegressor  # which takes a second to import

            options = {"min_samples_leaf": LEAF, "max_features": TRIED, "random_state": self._seed % 2**32}
            genomes, hardness = (np.array(column) for column in zip(*self._known, strict=True))
            self._trees, self._fitted = ExtraTreesRegressor(TREES, **options).fit(genomes, hardness), len(genomes)

    def _genome(self, number: int, rng: Rng) -> Genome:
        if self._trees is None or rng.random() < (GUIDED if self._failures else BLIND):
            return self._proposals.fresh(rng)
        self._stock = np.vstack([self._stock, *(self._candidate(rng) for _ in range(SUPPLY))])
        worth = self._trees.predict(self._stock)
        if failures := [*self._failures, *self._pending.values()]:
            from sklearn.neighbors import NearestNeighbors

            known = NearestNeighbors(n_neighbors=min(NEIGHBOURS, len(failures))).fit(self._embedded(failures))
            worth = worth * known.kneighbors(self._embedded(self._stock))[0].mean(axis=1)
        best, *others = np.argsort(-np.round(worth, DIGITS), kind="stable")[: KEPT + 1]
        self._pending[number], self._stock = self._stock[best], self._stock[others]
        return self._pending[number]

    def _candidate(self, rng: Rng) -> Genome:
        if not self._failures or rng.random() >= CROSSED:
            return self._proposals.fresh(rng)
        failure, variation = self._failures[rng.integers(len(self._failures))], self._variation
        return self._proposals.first_new(lambda: variation.cross(failure, self._proposals.sampled(rng), rng), rng)

    def _embedded(self, genomes: Sequence[Genome] | Points) -> Points:
        return np.array([self._space.embed(self._space.decode(genome)) for genome in genomes])
