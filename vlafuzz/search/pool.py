"""The scenes of a file in place of a search space, in order."""

from collections.abc import Sequence

import numpy as np

from vlafuzz.model.scene import Scene
from vlafuzz.search.base import Genome, Proposal
from vlafuzz.search.proposals import UNLIMITED
from vlafuzz.search.scoring import Measure, Score


class Pool:
    """Scenes from a file: a genome is a scene's index, not in [0, 1]."""

    dim = 1

    def __init__(self, scenes: Sequence[Scene], measure: Measure) -> None:
        self.scenes = tuple(scenes)
        self.severity, self.severities = measure.severity, measure.severities
        self.groups, self.site = measure.groups, measure.site

    def decode(self, genome: Genome) -> Scene:
        return self.scenes[int(genome[0])]


class InOrder:
    """Proposes the scenes of a pool in order, each once."""

    outstanding = UNLIMITED

    def __init__(self, size: int) -> None:
        self._size, self._asked = size, 0

    def ask(self, n: int) -> list[Proposal]:
        """The next ``n`` scenes, fewer at the end."""
        first, self._asked = self._asked, min(self._asked + n, self._size)
        return [Proposal(index, np.array([index], dtype=np.float64)) for index in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Scores change nothing."""
