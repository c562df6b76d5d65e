"""Where a policy fails, as numbers to draw: failure rates along the axes of the scenes, and the scenes themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.common.statistics import Share, wilson
from vlafuzz.model import Scene, Space
from vlafuzz.model.scene import unit_of
from vlafuzz.model.space import spoken
from vlafuzz.search.severity import half_of
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import SceneMap

PLACES = 41  # of a curve
ENOUGH = 40  # random scenes with which curves mean much, ten in each quarter of a range
FEWEST = 5  # random scenes with which there are curves at all
# Standard deviation of the window in which a rate is taken, as a share of the range: with 60 random scenes a tenth of
# the range, so that a window holds about 15 of them, and narrower with more.
WIDTH, SCENES = 0.1, 60
Value = float | str
Rate = tuple[float, float, float]  # a failure rate and its 95 % interval


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A quantity of the scenes, along which a policy may fail.

    Attributes:
        quantity: see ``Space.quantity``.
        sides: what stands behind amounts below and above zero in place of their sign.
        low, high, nominal: the range; of names the indices in ``options``.
        log: drawn by its logarithm.
        curve: failure rates of random scenes at places of the axis; ``bars``: of each option.
    """

    operator: str
    quantity: str
    name: str
    unit: str = ""
    sides: tuple[str, str] | None = None
    low: float = 0.0
    high: float = 1.0
    nominal: float = 0.0
    log: bool = False
    options: tuple[str, ...] = ()
    curve: tuple[tuple[float, Rate], ...] = ()
    bars: tuple[Share, ...] = ()

    @property
    def id(self) -> str:
        """Its name in the address of a page."""
        return self.quantity if "." in self.quantity else f"{self.operator}.{self.quantity}"

    def share(self, value: float) -> float:
        """The position of a value between the ends, in [0, 1]."""
        low, high, here = (np.log(max(one, 1e-9)) if self.log else one for one in (self.low, self.high, value))
        return float(min(max((here - low) / (high - low), 0.0), 1.0)) if high > low else 0.5

    def says(self, value: float) -> str:
        """A value with its unit."""
        if self.sides:
            return f"{abs(value):.3g}{self.unit}{self.sides[value > 0]}"
        return f"× {value:.3g}" if self.unit == "×" else f"{value:.3g}{self.unit}"

    def value(self, space: Space, scene: Scene) -> float | None:
        """The value of a scene, an option's as its index; None where it has none."""
        value = value_in(space, scene, self.operator, self.quantity)
        if self.options:
            return float(self.options.index(value)) if value in self.options else None
        return value if isinstance(value, int | float) else None


@dataclass(frozen=True, eq=False)
class Plot:
    """The scenes of runs that differ in search and seed only.

    Attributes:
        scenes: that passed or failed, each with whether it failed, and whether it was drawn without regard to outcomes.
        severity: how far scenes reach towards the ends of the ranges, if a run was to find where one half fails.
    """

    title: str
    space: Space
    axes: tuple[Axis, ...]
    scenes: Sequence[tuple[Scene, bool, bool]]
    severity: Axis | None

    @property
    def random(self) -> int:
        """The number of random scenes."""
        return sum(drawn for _, _, drawn in self.scenes)

    @cached_property
    def maps(self) -> list[SceneMap]:
        """The maps that the world has of what varies."""
        known = {axis.quantity for axis in self.axes}
        return [
            one for one in world_of(self.space.task.name).maps(self.space.task.name) if {one.across, one.along} <= known
        ]

    def values(self, scene: Scene) -> list[float | None]:
        """The values of a scene, by axis."""
        return [axis.value(self.space, scene) for axis in self.axes]


def quantities(space: Space, scenes: Sequence[Scene]) -> Mapping[tuple[str, str, str], Sequence[Value | None]]:
    """The value in each scene of what varies, by operator, name in words, and path or derived name.

    Confounders are told by number and nearness, displacements by what is derived of them.
    """
    keys = dict.fromkeys((operator, name, name) for scene in scenes for operator, name in space.derived(scene))
    told = {operator for operator, _, _ in keys}
    genes = []
    for gene in space.genes:
        if gene.operator not in told and not gene.slot.startswith("confounders"):
            *_, slot, name = ("", *gene.path.split("."))
            owner = f" of object {int(slot) + 1}" if slot.isdigit() and slot != "0" else ""
            quantity = "" if name in ("object", "confounders", "instruction", gene.operator) else name
            genes.append((gene.operator, f"{quantity}{owner}".strip(), gene.path))
    found = {key: [value_in(space, scene, key[0], key[2]) for scene in scenes] for key in (*genes, *keys)}
    return {key: values for key, values in found.items() if len({*values} - {None}) > 1}


def value_in(space: Space, scene: Scene, operator: str, quantity: str) -> Value | None:
    """A number, or the name of an option in words; see ``Space.quantity``."""
    value = space.quantity(scene, operator, quantity)
    return value if value is None or isinstance(value, (int, float)) else str(value).replace("_", " ")


def plot_of(
    title: str, space: Space, scenes: Sequence[tuple[Scene, bool, bool]], severities: Sequence[tuple[float, bool]] = ()
) -> Plot:
    """The plot of ``Plot.scenes``; ``severities``: of a run at all of them, and whether each scene failed."""
    drawn = [(scene, failed) for scene, failed, random in scenes if random]
    failed = np.array([failed for _, failed in drawn], dtype=bool)
    axes = []
    for (operator, name, quantity), values in quantities(space, [scene for scene, _, _ in scenes]).items():
        axis = Axis(operator=operator, quantity=quantity, name=spoken(operator, name), unit=unit_of(quantity))
        known = [value for value in values if value is not None]
        if any(isinstance(value, str) for value in known):
            options = tuple(sorted({str(value) for value in known}))
            axis = replace(axis, high=len(options) - 1, options=options)
        elif gene := space.by_path.get(quantity):
            grid = gene.grid
            axis = replace(axis, low=grid.low, high=grid.high, nominal=grid.nominal, log=grid.log)
        else:
            numbers = [float(value) for value in known]
            most = max(map(abs, numbers))
            axis = replace(axis, low=-most if min(numbers) < 0 else min(numbers), high=most)
        places = np.array([axis.value(space, scene) for scene, _ in drawn], dtype=float)  # None is no number
        axes.append(_rated(axis, places[~np.isnan(places)], failed[~np.isnan(places)]))
    if not severities:
        return Plot(title, space, tuple(axes), scenes, None)
    half, (reach, bad) = half_of(severities), np.array(severities).T
    severity = Axis(operator="", quantity="severity", name=f"severity: one half fails at {half}", nominal=half.value)
    return Plot(title, space, tuple(axes), scenes, _rated(severity, reach, bad == 1))


def _rated(axis: Axis, values: Array, failed: Mask) -> Axis:
    """The axis with the failure rates along it; as it is where there are hardly any random scenes."""
    if axis.options:
        groups = [failed[values == option] for option in range(len(axis.options))]
        return replace(axis, bars=tuple(Share.of_counts(int(one.sum()), len(one)) for one in groups))
    if len(values) < FEWEST:
        return axis
    shares, ends = np.array([axis.share(value) for value in values]), np.linspace(0.0, 1.0, PLACES)
    width = WIDTH * (SCENES / max(len(values), SCENES)) ** 0.2
    weights = np.exp(-(((ends[:, None] - shares) / width) ** 2) / 2)
    worth = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)  # scenes that would tell as much with equal weights
    rates = np.clip(weights @ failed / weights.sum(axis=1), 0, 1)
    places = (np.geomspace if axis.log else np.linspace)(axis.low, axis.high, PLACES)
    found = zip(places.tolist(), rates.tolist(), worth.tolist(), strict=True)
    return replace(axis, curve=tuple((at, (rate, *wilson(rate * number, number))) for at, rate, number in found))
