"""Toy: planted failures in closed form, with known ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from strategies.search import search
from tests.search.toy import Region, Signal, Toy, among, band, near
from vlafuzz.model import Scene
from vlafuzz.search.registry import strategy_factory
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

TASK = "pick-up"
SAMPLES = 20_000  # scenes to measure a region's share with: 100 of them are in a region of 0.5 %
SHAPES = {
    "box of 3 genes": Region(
        (
            near("targets.0.x", 0.05, 0.32),
            near("targets.0.yaw", 90.0, 360.0, period=360.0),
            near("camera.pitch", -2.5, 10.0),
        )
    ),
    "box of 4 genes": Region(
        (
            near("targets.0.x", -0.10, 0.32),
            near("targets.0.y", 0.12, 0.50),
            near("light.intensity", -2.0, 8.6),
            near("camera.roll", 2.0, 10.0),
        )
    ),
    "thin slab": Region(
        (band({"targets.0.x": 3.1, "targets.0.y": 2.0, "light.intensity": 0.116, "camera.yaw": 0.1}, centre=1.0),)
    ),
    "three operators": Region(
        (near("light.intensity", -4.3, 8.6), near("camera.distance", 0.05, 0.05), near("confounders", 3.0, 3.0))
    ),
    "three objects": Region(
        (
            among("targets.0.object", load_catalogue().names("graspable")[3:6]),
            near("light.intensity", 4.3, 8.6),
            near("camera.yaw", 5.0, 10.0),
        )
    ),
}


@dataclass(frozen=True)
class Planted:
    """A region of a shape that holds a share of the random scenes, and the signal near the region."""

    shape: str
    share: float
    signal: Signal
    width: float

    @property
    def name(self) -> str:
        return f"{self.shape}, {self.share:.1%}, {self.signal}"

    def play(self, strategy: str, seed: int, budget: int) -> dict[str, float]:
        """A campaign without a store; known and invalid scenes cost nothing."""
        space = _space()
        region = replace(SHAPES[self.shape], width=self.width)
        toy = Toy(region, space.catalogue, min_distance=space.operators.min_distance, signal=self.signal)
        searching = strategy_factory(strategy)(space, seed, budget)
        batches = search(space, lambda scene: toy.evaluate([scene])[0], searching, budget)
        failures = [judged for batch in batches for _, judged in batch if judged.failed]
        return {"cells": len({judged.cell for judged in failures}), "failures": len(failures)}


def cases(shares: Sequence[float], signals: Sequence[Signal], seed: int) -> list[Planted]:
    """All shapes, scaled by sampling so that they hold each share."""
    scenes = _samples(seed)
    return [
        Planted(shape, share, signal, region.calibrated(scenes, share).width)
        for shape, region in SHAPES.items()
        for share in shares
        for signal in signals
    ]


@cache
def _space() -> SearchSpace:
    return SearchSpace(load_operators(), load_catalogue(), TASK)


def _samples(seed: int) -> list[Scene]:
    return [_space().sample(np.random.default_rng([seed, 1, index])) for index in range(SAMPLES)]
