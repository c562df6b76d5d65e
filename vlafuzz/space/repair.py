"""Repair: a scene of the space that breaks a rule, changed as little as it takes to keep them all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vlafuzz.scene import Scene
from vlafuzz.space.generate import Attempt

if TYPE_CHECKING:
    from vlafuzz.space.codec import SearchSpace


def repair(space: SearchSpace, scene: Scene, rng: np.random.Generator) -> Scene | None:
    """The scene itself if it passes the semantic and the geometric checks, else one near it that does.

    Objects are looked at in their order, the targets first, so it is rather a confounder that gives way. None
    when bounded redrawing finds no room.
    """
    attempt = Attempt(space, rng)
    values = space.values(scene)
    layout = space.composer.layout
    for slot in [*layout.of("targets"), *layout.of("confounders")[: len(scene.confounders)]]:
        if not attempt.keep(slot, values):
            return None
    return space.composer.compose(values)
