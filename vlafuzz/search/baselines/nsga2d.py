"""NSGA-II with a diversity fitness and repopulation: it keeps away from the failures that it has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.scoring import Score
from vlafuzz.search.base import Proposal, Source
from vlafuzz.search.nsga2 import MOST_SEVERE, Nsga2

LEAVES = 0.5  # share of the population that gives way to fresh scenes when it stalls


class Nsga2D(Nsga2):
    """NSGA-II-D: Sorokin, Safin, Nejati 2024 <https://doi.org/10.1007/s10664-024-10599-9>.

    Every scene, failing or not, is ranked by the distance from the failures found before, beside progress and
    severity: an archive of failures repels the population. Once a whole generation reaches no new cell, the
    worse half of the population gives way to fresh scenes.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed, budget)
        self._cells: set[str] = set()
        self._stalled = self._vacant = 0

    def ask(self, n: int) -> list[Proposal]:
        """As NSGA-II does, after fresh scenes for the places that are vacant."""
        proposals = super().ask(n)
        self._vacant = max(self._vacant - n, 0)
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Let the batch compete, and look whether anything new came of it."""
        super().tell(proposals, scores)
        reached = {score.cell for score in scores if score.failed and score.cell} - self._cells
        self._cells |= reached
        self._stalled = 0 if reached or not self._cells else self._stalled + len(proposals)
        if self._stalled >= self._size:
            self._repopulate()

    def _repopulate(self) -> None:
        """Keep the better half."""
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
        """To be made small. What was not judged is behind everything else by its constraint."""
        return (score.ease, score.severity, -novelty) if score.rolled_out else (0.0, MOST_SEVERE, 0.0)
