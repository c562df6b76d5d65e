"""Regions: the scenes in the ranges that fail for a certified cause, as it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model import Causes, Scene, Space
from vlafuzz.search.causes.units import Units
from vlafuzz.search.probability import Probability, share_of_range, shared_out

DRAWN = 1500  # random scenes without a rollout, 2 ms each: a range of 14 % is known to within 0.9 points (1 sigma)
SLACK = 1e-6  # of the way to a scene


@dataclass(frozen=True)
class Band:
    """The values of a quantity between which a policy fails; an open end is infinite.

    Attributes:
        quantity: the path of a gene, or the name of what is derived of the operator, see ``Space.quantity``.
    """

    operator: str
    quantity: str
    low: float
    high: float

    def holds(self, space: Space, scene: Scene) -> bool:
        """Whether the value of a scene is between them."""
        value = space.quantity(scene, self.operator, self.quantity)
        return isinstance(value, int | float) and self.low <= value <= self.high


def bands_of(space: Space, scene: Scene, causes: Causes) -> tuple[Band, ...]:
    """What the thresholds of a minimal scene bound: of a displacement along its farthest direction."""
    values, bands = space.values(scene), list[Band]()
    for name, threshold in ((one.operator, one) for one in causes.thresholds):
        ways = {way: abs(far) for (operator, way), far in space.derived(scene).items() if operator == name}
        paths = [path for path, _ in threshold.at]
        if not ways and len(paths) > 1:
            continue  # several move together: no single range says which fail
        quantity = max(ways, key=ways.__getitem__, default=paths[0])
        usual = float(space.quantity(space.nominal(like=scene), name, quantity) or 0.0)
        for ends in threshold.fails:
            scenes = (space.compose(values | dict(end)) for end in ends if end)
            low, *high = (float(space.quantity(one, name, quantity)) for one in scenes)
            bands.append(Band(name, quantity, *sorted((low, high[0] if high else inf if low > usual else -inf))))
    return tuple(bands)


@dataclass(frozen=True, eq=False)
class Range:
    """The range of a certified cause, with what no single quantity bounds: in the way of its scene, as far off.

    Args:
        scene: the minimal one.
        operators: all that the cause takes.
    """

    space: Space
    scene: Scene
    operators: tuple[str, ...]
    causes: Causes

    def holds(self, scenes: Sequence[Scene]) -> NDArray[np.bool_]:
        """``(n,)`` which of these scenes are in it."""
        space, bands = self.space, bands_of(self.space, self.scene, self.causes)
        bounded = {band.operator for band in bands}
        within = [{band.operator for band in bands if band.holds(space, scene)} for scene in scenes]
        inside = np.array([operators == bounded for operators in within], dtype=bool)
        unbounded = set(self.operators) - bounded
        if unbounded and len(scenes):
            units = Units(space.genes)
            levels = np.array([units.levels(space.nearest(scene)) for scene in (self.scene, *scenes)])
            own, *others = units.deviations(levels)
            starts = {one.operator: one.share for one in self.causes.thresholds}
            for name in unbounded:
                inside &= units.doses((name,), np.array(others), own) >= starts.get(name, 1.0) - SLACK
        return inside


@lru_cache(maxsize=4)
def _drawn(space: Space, number: int) -> list[Scene]:
    """Random scenes of a space, kept for all lists of causes that are made of its runs."""
    return [space.sample(np.random.default_rng([each, 2])) for each in range(number)]


def shares(space: Space, ranges: Sequence[Range], scenes: Sequence[tuple[Scene, bool]]) -> list[Probability]:
    """The shares of random scenes that fail in each range; a scene in several is shared out.

    Args:
        scenes: random ones, each with whether it failed.
    """

    def inside(some: Sequence[Scene]) -> NDArray[np.float64]:
        return shared_out(np.stack([one.holds(some) for one in ranges], axis=1))

    failed = np.array([bad for _, bad in scenes])
    parts = inside(_drawn(space, DRAWN))
    weights = inside([scene for scene, _ in scenes])
    return [share_of_range(*pair, failed) for pair in zip(parts.T, weights.T, strict=True)]
