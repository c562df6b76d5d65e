"""Random testing, the paper's strategy: scenes are drawn independently of earlier outcomes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.scoring import Score
from vlafuzz.search.base import Proposal, Source


class Random:
    """Draws scenes independently of earlier outcomes: VLATest's strategy.

    Each proposal has its own random generator: batch size and workers do not change the scenes.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        self._space, self._seed, self._asked = space, seed, 0

    def ask(self, n: int) -> list[Proposal]:
        """``n`` random proposals."""
        first, self._asked = self._asked, self._asked + n
        return [self._proposal(number) for number in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Scores change nothing."""

    def _proposal(self, number: int) -> Proposal:
        rng = np.random.default_rng([self._seed, number])
        return Proposal(number, self._space.encode(self._space.sample(rng)))
