"""Repair: changes a scene that breaks a rule as little as necessary."""

from __future__ import annotations

import numpy as np

from vlafuzz.scene import Scene
from vlafuzz.space.codec import Codec
from vlafuzz.space.generate import Attempt


def repair(space: Codec, scene: Scene, rng: np.random.Generator) -> Scene | None:
    """The scene itself if it passes the semantic and geometric checks, else a nearby one that does.

    Objects are placed in order, targets first, so that confounders give way to targets. None when bounded
    redrawing finds no room.
    """
    attempt = Attempt(space, rng)
    values = space.values(scene)
    layout = space.composer.layout
    for slot in [*layout.of("targets"), *layout.of("confounders")[: len(scene.confounders)]]:
        if not attempt.keep(slot, values):
            return None
    return space.composer.compose(values)
