"""SearchSpace: what strategies search, the codec together with random generation and repair."""

from __future__ import annotations

import numpy as np

from vlafuzz.scene import Scene
from vlafuzz.space.codec import Codec
from vlafuzz.space.generate import generate
from vlafuzz.space.repair import repair


class SearchSpace(Codec):
    """Every scene that the operators can make of a task, with random generation and repair."""

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene that passes the semantic and the geometric checks.

        Raises:
            UsageError: the ranges leave no room for the objects.
        """
        return generate(self, rng)

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene with as little redrawn as it takes to pass these checks; None when there is no room."""
        return repair(self, scene, rng)
