"""Where a policy fails, as numbers to draw: failure rates along the axes of the scenes, and the scenes themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import Share, wilson
from vlafuzz.failures.described import DescribedFailure
from vlafuzz.model.evidence import Threshold
from vlafuzz.model.scene import Scene, unit_of
from vlafuzz.model.space import Space, spoken, value_at
from vlafuzz.report.effects import ENOUGH, FEWEST, quantities
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import SceneMap

MOST = 1500  # scenes that are drawn; of more an even selection
PLACES = 41  # of a curve
# Standard deviation of the window in which a rate is taken, as a share of the range: with 60 random scenes a tenth of
# the range, so that a window holds about 15 of them, and narrower with more.
WIDTH, SCENES = 0.1, 60
Numbers = NDArray[np.float64]
Rate = tuple[float, float, float]  # a failure rate and its 95 % interval


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A quantity of the scenes, along which a policy may fail.

    Attributes:
        id: the path of a gene, or the operator and what the space calls a quantity of it.
        low, high, nominal: the range; of names the indices in ``options``.
        log: drawn by its logarithm.
        curve: failure rates of random scenes at places of the axis; ``bars``: of each option, with its scenes.
    """

    id: str
    operator: str
    name: str
    unit: str = ""
    low: float
    high: float
    nominal: float = 0.0
    log: bool = False
    options: tuple[str, ...] = ()
    curve: tuple[tuple[float, Rate], ...] = ()
    bars: tuple[Share, ...] = ()

    def share(self, value: float) -> float:
        """The position of a value between the ends, in [0, 1]."""
        low, high, here = (np.log(max(one, 1e-9)) if self.log else one for one in (self.low, self.high, value))
        return float(min(max((here - low) / (high - low), 0.0), 1.0)) if high > low else 0.5

    def at(self, share: float) -> float:
        """The value at a position."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + (self.high - self.low) * share

    def says(self, value: float) -> str:
        """A value with its unit."""
        if self.options:
            return self.options[int(value)]
        return f"× {value:.3g}" if self.unit == "×" else f"{value:.3g}{self.unit}"


@dataclass(frozen=True)
class Band:
    """The values of an axis between which a policy fails for a cause."""

    axis: str
    low: float
    high: float

    def holds(self, value: float | None) -> bool:
        return value is not None and self.low <= value <= self.high


@dataclass(frozen=True)
class Point:
    """A scene; ``values`` by axis, None where it has none. ``drawn``: at random, without regard to outcomes."""

    digest: str
    failed: bool
    drawn: bool
    values: tuple[float | None, ...]


@dataclass(frozen=True, eq=False)
class Plot:
    """The scenes of runs that differ in search and seed only.

    Attributes:
        random: number of random scenes.
        points: scenes that were judged.
    """

    title: str
    space: Space
    axes: tuple[Axis, ...]
    points: tuple[Point, ...]
    maps: tuple[SceneMap, ...] = ()

    @property
    def drawn(self) -> list[Point]:
        return [point for point in self.points if point.drawn]

    @property
    def enough(self) -> bool:
        """Whether there are random scenes enough for curves that mean something."""
        return len(self.drawn) >= ENOUGH

    @property
    def shown(self) -> Sequence[Point]:
        """At most ``MOST`` of the points."""
        step = -(-len(self.points) // MOST)
        return self.points[:: max(step, 1)]

    @cached_property
    def index(self) -> Mapping[str, int]:
        return {axis.id: number for number, axis in enumerate(self.axes)}

    def values(self, scene: Scene) -> tuple[float | None, ...]:
        """The values of a scene, by axis."""
        return tuple(_value(self.space, axis, scene) for axis in self.axes)

    def bands(self, failure: DescribedFailure) -> dict[str, tuple[Band, ...]]:
        """The ranges that fail, by operator: of those with a threshold that is on one axis."""
        found = {}
        values = self.space.values(failure.scene)
        for threshold in failure.causes.thresholds:
            if (axis := self._axis_of(threshold, failure.scene)) is None:
                continue
            bands = []
            for ends in threshold.fails:
                scenes = (self.space.compose(values | dict(end)) for end in ends if end)
                low, *high = (_value(self.space, axis, scene) or 0.0 for scene in scenes)
                first, last = sorted((low, high[0] if high else axis.high if low > axis.nominal else axis.low))
                bands.append(Band(axis.id, first, last))
            found[threshold.operator] = tuple(bands)
        return found

    def _axis_of(self, threshold: Threshold, scene: Scene) -> Axis | None:
        """The axis that a threshold is on: of a displacement the one along which the scene is farthest off."""
        (path, *more), operator = dict(threshold.at), threshold.operator
        ways = {
            f"{name}.{way}": abs(far) for (name, way), far in self.space.displaced(scene).items() if name == operator
        }
        wanted = max(ways, key=lambda way: ways[way]) if ways else path
        return self.axes[self.index[wanted]] if wanted in self.index and (ways or not more) else None

    def inside(self, bands: Sequence[Band]) -> Share:
        """Of the random scenes in the ranges, those that fail; of an axis with several ranges, in any of them."""
        ranges: dict[int, list[Band]] = {}
        for band in bands:
            ranges.setdefault(self.index[band.axis], []).append(band)
        within = [
            point.failed
            for point in self.drawn
            if all(any(one.holds(point.values[axis]) for one in several) for axis, several in ranges.items())
        ]
        return Share.of_counts(sum(within), len(within))


def plot_of(title: str, space: Space, scenes: Sequence[tuple[Scene, bool, bool]]) -> Plot:
    """The axes, curves and points of scenes, each with whether it failed and whether it was drawn at random."""
    axes = _axes(space, [scene for scene, _, _ in scenes])
    rows = [tuple(_value(space, axis, scene) for axis in axes) for scene, _, _ in scenes]
    random = np.array([drawn for _, _, drawn in scenes], dtype=bool)
    failures = np.array([failed for _, failed, _ in scenes], dtype=bool)
    columns = np.array(rows, dtype=float).reshape(len(rows), len(axes)).T  # None is no number
    rated = tuple(_rated(axis, column[random], failures[random]) for axis, column in zip(axes, columns, strict=True))
    points = tuple(
        Point(scene.digest, failed, drawn, row) for (scene, failed, drawn), row in zip(scenes, rows, strict=True)
    )
    ids = {axis.id for axis in axes}
    maps = world_of(space.task.name).maps(space.task.name)
    return Plot(title, space, rated, points, tuple(one for one in maps if {one.across, one.along} <= ids))


def _axes(space: Space, scenes: Sequence[Scene]) -> list[Axis]:
    """One for each quantity that varies; of displacements, as people see them, not by distances and angles."""
    ways = [space.displaced(scene) for scene in scenes]
    moved, found = {operator for one in ways for operator, _ in one}, []
    for (operator, quantity, path), values in quantities(space, scenes).items():
        known, of = [value for value in values if value is not None], "" if quantity == operator else quantity
        axis = Axis(id=path, operator=operator, name=_spoken(operator, of), unit=unit_of(path), low=0.0, high=1.0)
        if operator in moved:
            continue
        if any(isinstance(value, str) for value in known):
            options = tuple(sorted({str(value) for value in known}))
            found.append(replace(axis, high=len(options) - 1, options=options))
        elif gene := space.by_path.get(path):
            grid = gene.grid
            found.append(replace(axis, low=grid.low, high=grid.high, nominal=grid.nominal, log=grid.log))
        else:
            numbers = [float(value) for value in known]
            found.append(replace(axis, id=f"{operator}.{quantity}", low=min(numbers), high=max(numbers)))
    for operator, way in dict.fromkeys(key for one in ways for key in one):
        most = max(abs(one[operator, way]) for one in ways)
        unit, _, direction = way.partition(" ")
        if most:
            name = _spoken(operator, direction)
            found.append(
                Axis(id=f"{operator}.{way}", operator=operator, name=name, unit=f" {unit}", low=-most, high=most)
            )
    return found


def _spoken(operator: str, quantity: str) -> str:
    return f"{spoken(operator)} {quantity}".strip().replace("-", " ")


def _value(space: Space, axis: Axis, scene: Scene) -> float | None:
    """The value of a scene on an axis; None where it has none."""
    if axis.id not in space.by_path:
        key = (axis.operator, axis.id.removeprefix(f"{axis.operator}."))
        return {**space.displaced(scene), **space.derived(scene)}.get(key)
    try:
        value = value_at(scene, axis.id)
    except (IndexError, KeyError):
        return None
    if not axis.options:
        return float(value)
    name = str(value).replace("_", " ")
    return float(axis.options.index(name)) if name in axis.options else None


def _rated(axis: Axis, values: Numbers, failed: NDArray[np.bool_]) -> Axis:
    """The axis with the failure rates along it; as it is where there are hardly any random scenes."""
    known = ~np.isnan(values)
    values, failed = values[known], failed[known]
    if axis.options:
        groups = [failed[values == option] for option in range(len(axis.options))]
        return replace(axis, bars=tuple(Share.of_counts(int(one.sum()), len(one)) for one in groups))
    if len(values) < FEWEST:
        return axis
    places = np.array([axis.share(value) for value in values])
    width = WIDTH * (SCENES / max(len(values), SCENES)) ** 0.2
    ends = np.linspace(0.0, 1.0, PLACES)
    weights = np.exp(-(((ends[:, None] - places) / width) ** 2) / 2)
    scenes = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)  # that would tell as much with equal weights
    rates = np.clip(weights @ failed / weights.sum(axis=1), 0, 1)
    bounds = [wilson(rate * number, number) for rate, number in zip(rates, scenes, strict=True)]
    curve = [(axis.at(end), (rate, *bound)) for end, rate, bound in zip(ends, rates.tolist(), bounds, strict=True)]
    return replace(axis, curve=tuple(curve))
