"""A fixed pool of scenes in place of a search space: a genome is a scene's index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vlafuzz.scene import Scene
from vlafuzz.scoring import Measure, Score
from vlafuzz.search.base import Genome, Proposal


class Pool:
    """Scenes from a file; ``measure`` gives their severities."""

    def __init__(self, scenes: Sequence[Scene], measure: Measure) -> None:
        self.scenes, self._measure = tuple(scenes), measure

    @property
    def dim(self) -> int:
        """1: a genome is a scene's index, not in [0, 1]."""
        return 1

    def decode(self, genome: Genome) -> Scene:
        """The scene at that index."""
        return self.scenes[int(genome[0])]

    def encode(self, scene: Scene) -> Genome:
        """The scene's index."""
        return np.array([self.scenes.index(scene)], dtype=np.float64)

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene of the pool."""
        return self.scenes[rng.integers(len(self.scenes))]

    def severity(self, scene: Scene) -> float:
        """See ``Measure``."""
        return self._measure.severity(scene)

    def severities(self, scene: Scene) -> Mapping[str, float]:
        """See ``Measure``."""
        return self._measure.severities(scene)


class InOrder:
    """Proposes the scenes of a pool in order, each once."""

    def __init__(self, size: int) -> None:
        self._size, self._asked = size, 0

    def ask(self, n: int) -> list[Proposal]:
        """The next ``n`` scenes, fewer at the end."""
        first, self._asked = self._asked, min(self._asked + n, self._size)
        return [Proposal(index, np.array([index], dtype=np.float64)) for index in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Scores change nothing."""
