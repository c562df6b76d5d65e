"""Regions: the scenes in the ranges that fail for a certified cause, as it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from vlafuzz.common.statistics import wilson
from vlafuzz.model.evidence import Causes, Threshold
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.search.probability import Probability


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

    def holds(self, value: object) -> bool:
        return isinstance(value, int | float) and self.low <= value <= self.high


@dataclass(frozen=True)
class Region:
    """The bands of a cause: a scene is inside if each operator is in one of its own.

    Attributes:
        whole: whether there are bands for all that it takes; else more is needed than to be inside.
    """

    bands: tuple[Band, ...] = ()
    whole: bool = False

    def holds(self, space: Space, scene: Scene) -> bool:
        """Whether each operator is in one of its bands."""
        within = (
            band.operator for band in self.bands if band.holds(space.quantity(scene, band.operator, band.quantity))
        )
        return set(within) == {band.operator for band in self.bands}


def region_of(space: Space, scene: Scene, operators: Sequence[str], causes: Causes) -> Region:
    """The region that the thresholds of a minimal scene bound: of a displacement along its farthest direction."""
    bands = [band for threshold in causes.thresholds for band in _bands(space, scene, threshold)]
    covered = {band.operator for band in bands}
    return Region(tuple(bands), whole=bool(operators) and covered == set(operators))


def _bands(space: Space, scene: Scene, threshold: Threshold) -> list[Band]:
    ways = {name: far for (operator, name), far in space.derived(scene).items() if operator == threshold.operator}
    paths = [path for path, _ in threshold.at]
    if not ways and len(paths) > 1:
        return []  # several move together: no single range says which fail
    quantity = max(ways, key=lambda way: abs(ways[way])) if ways else paths[0]
    values, bands = space.values(scene), list[Band]()
    usual = float(space.quantity(space.nominal(like=scene), threshold.operator, quantity) or 0.0)
    for ends in threshold.fails:
        scenes = (space.compose(values | dict(end)) for end in ends if end)
        low, *high = (float(space.quantity(one, threshold.operator, quantity)) for one in scenes)
        first, last = sorted((low, high[0] if high else inf if low > usual else -inf))
        bands.append(Band(threshold.operator, quantity, first, last))
    return bands


def shares(space: Space, regions: Sequence[Region], scenes: Sequence[tuple[Scene, bool]]) -> list[Probability]:
    """The shares of random scenes that fail in each region; a scene in several is shared out.

    Args:
        scenes: each with whether it failed; at least one.
    """
    counts = [0.0] * len(regions)
    for scene, failed in scenes:
        inside = [index for index, region in enumerate(regions) if failed and region.holds(space, scene)]
        for index in inside:
            counts[index] += 1 / len(inside)
    return [Probability(count / len(scenes), *wilson(count, len(scenes))) for count in counts]
