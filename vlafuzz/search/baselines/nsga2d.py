"""NSGA-II-D: NSGA-II with a diversity objective and repopulation."""

from collections.abc import Sequence

import numpy as np

from vlafuzz.search.base import Proposal, Source
from vlafuzz.search.nsga2 import MOST_SEVERE, Nsga2
from vlafuzz.search.scoring import Score

LEAVES = 0.5  # share of the population replaced by random scenes when it stalls


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
