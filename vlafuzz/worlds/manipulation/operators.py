"""The scene operators: what each varies, in which ranges, and its genes in a task. Extras have a file of their own."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from vlafuzz.model import Gene, Grid
from vlafuzz.worlds.manipulation.base import Box, Layout, Number, Operator, Range, Span, Step, check_levels
from vlafuzz.worlds.manipulation.extras import EXTRA_KINDS

MOST_CONFOUNDERS = 4


class _Type(Operator):
    nominal_text = "the first that the task allows"
    names: tuple[str, ...] | None = Field(default=None, strict=False, min_length=1)

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for slot in layout.of(self.part):
            grid = Grid.choice(len(layout.slots[slot]), layout.nominal[slot])
            yield self._gene(f"{slot}.object", "category", grid)

    def ranges(self) -> str:
        onto = getattr(self, "onto", None)
        named = [", ".join(self.names)] if self.names else ["all that the task allows"]
        return "; onto ".join([*named, ", ".join(onto)] if onto else named)


class TargetType(_Type):
    """The targets: which of ``names`` is manipulated, and which of ``onto`` it is brought to."""

    name, says, part = "target-type", "which objects the task is about", "targets"
    onto: tuple[str, ...] | None = Field(default=None, strict=False, min_length=1)


class ConfounderType(_Type):
    """The other objects on the table: all that can be grasped, or those of ``names``."""

    name, says, part = "confounder-type", "which other objects are there", "confounders"


class _Position(Operator):
    range_text = "x {x} m, y {y} m"
    spots: ClassVar[int]
    x: Span
    y: Span
    nominal: tuple[Annotated[tuple[Number, Number], Field(strict=False)], ...] = Field(strict=False)

    @model_validator(mode="after")
    def _has_spots(self) -> Self:
        if len(self.nominal) != self.spots:
            raise ValueError(f"nominal has {len(self.nominal)} places, {self.spots} are needed")
        for index, (x, y) in enumerate(self.nominal):
            box = self._box(index)
            if not (box.x.holds(x) and box.y.holds(y)):
                raise ValueError(f"the nominal place ({x:g}, {y:g}) is outside its box")
        return self

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for index, slot in enumerate(layout.of(self.part)):
            box, (x, y) = self._box(index), self.nominal[index]
            yield self._gene(f"{slot}.x", "real", box.x.grid(x))
            yield self._gene(f"{slot}.y", "real", box.y.grid(y))

    def _box(self, index: int) -> Box:
        return Box(x=self.x, y=self.y)

    def nominally(self) -> str:
        return ", ".join(f"({x:g}, {y:g})" for x, y in self.nominal)


class TargetPosition(_Position):
    """The targets' places, the second one in the box ``onto`` if given. One nominal place per target."""

    name, says, part, spots = "target-position", "where the targets stand", "targets", 2
    onto: Box | None = None

    def _box(self, index: int) -> Box:
        return self.onto if index == 1 and self.onto else super()._box(index)


class ConfounderPosition(_Position):
    """The confounders' places. One nominal place per slot."""

    name, says, part = "confounder-position", "where the confounders stand", "confounders"
    spots = MOST_CONFOUNDERS


class _Orientation(Operator):
    nominal_text = "first rest pose, {yaw.nominal:g}°"
    yaw: Range
    fixed: tuple[str, ...] = Field(default=(), strict=False)

    def genes(self, layout: Layout) -> Iterator[Gene]:
        yaw = self.yaw
        whole = yaw.high - yaw.low >= 360
        for slot in layout.of(self.part):
            yield self._gene(f"{slot}.rest", "category", Grid.choice(layout.stable_poses))
            nominal = yaw.high if whole and yaw.nominal == yaw.low else yaw.nominal  # the same angle
            grid = Grid(yaw.low, yaw.high, yaw.step, nominal, wraps=whole)
            yield self._gene(f"{slot}.yaw", "angle" if whole else "real", grid)

    def ranges(self) -> str:
        fixed = f", none when {' or '.join(self.fixed)}" if self.fixed else ""
        return f"any rest pose, yaw {self.yaw}°{fixed}"


class TargetOrientation(_Orientation):
    """The targets' rest poses, and their yaw, which does not vary in the ``fixed`` rest poses."""

    name, says, part = "target-orientation", "how the targets lie and are turned", "targets"


class ConfounderOrientation(_Orientation):
    """The confounders' rest poses, and their yaw, which does not vary in the ``fixed`` rest poses."""

    name, says, part = "confounder-orientation", "how the confounders lie and are turned", "confounders"


class ConfounderCount(Operator):
    """The number of objects beside the targets."""

    name, says = "confounder-count", "how many other objects are there"
    nominal_text, range_text = "{nominal}", "{low} to {high}"
    low: int = Field(ge=0, le=MOST_CONFOUNDERS)
    high: int = Field(ge=0, le=MOST_CONFOUNDERS)
    nominal: int

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low <= self.nominal <= self.high:
            raise ValueError(f"not low <= nominal <= high: {self.low}, {self.nominal}, {self.high}")
        return self

    def genes(self, layout: Layout) -> Iterator[Gene]:
        yield self._gene("confounders", "count", Grid(self.low, self.high, 1, self.nominal))


class Light(Operator):
    """A factor on all lights, stepped in log2 and drawn evenly in it, or by the paper's ``coin``."""

    name, says, nominal_text = "light", "a factor on all lights", "× {intensity.nominal:g}"
    intensity: Range
    spread: Literal["even", "coin"] = "even"

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if self.intensity.low <= 0:
            raise ValueError(f"intensity must be positive, low is {self.intensity.low:g}")
        check_levels(math.log2(self.intensity.low), math.log2(self.intensity.high), self.intensity.step)
        return self

    def genes(self, layout: Layout) -> Iterator[Gene]:
        span = self.intensity
        grid = Grid(span.low, span.high, span.step, span.nominal, log=True)
        yield Gene(self.name, "light.intensity", "real", grid, spread=self.spread)

    def ranges(self) -> str:
        drawn = "log-uniform" if self.spread == "even" else "fair coin dark or bright, linear"
        return f"× {self.intensity}, {drawn}"


class CameraPosition(Operator):
    """The camera's distance from its nominal position, in any direction."""

    name, says = "camera-position", "where the camera stands"
    nominal_text, range_text = "0 m", "{distance} m off, in any direction"
    distance: Range
    direction_step: Annotated[Step, Field(ge=0.01)]

    @model_validator(mode="after")
    def _not_negative(self) -> Self:
        if self.distance.low < 0 or self.distance.nominal != 0:
            raise ValueError("distance must start at 0, its nominal value")
        return self

    def genes(self, layout: Layout) -> Iterator[Gene]:
        step = self.direction_step
        yield self._gene("camera.distance", "real", self.distance.grid(0.0))
        yield Gene(self.name, "camera.azimuth", "angle", Grid(-180, 180, step, 0, wraps=True), neutral=True)
        elevation = Grid(-90, 90, step, 0)
        yield Gene(self.name, "camera.elevation", "real", elevation, neutral=True, spread="sphere")


class CameraOrientation(Operator):
    """The camera's rotation about its own axes."""

    name, says = "camera-orientation", "how the camera is turned"
    nominal_text = "{roll.nominal:g}°, {pitch.nominal:g}°, {yaw.nominal:g}°"
    range_text = "roll {roll}°, pitch {pitch}°, yaw {yaw}°"
    roll: Range
    pitch: Range
    yaw: Range

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for axis, span in self:
            yield self._gene(f"camera.{axis}", "real", span.grid(span.nominal))


class Wording(Operator):
    """The wording of the instruction."""

    name, says = "wording", "how the instruction is worded"
    nominal_text, range_text = "the first", "the wordings of instructions.yaml"

    def genes(self, layout: Layout) -> Iterator[Gene]:
        yield self._gene("instruction", "category", Grid.choice(layout.wordings))


_THINGS = (TargetType, TargetPosition, TargetOrientation, ConfounderType, ConfounderPosition, ConfounderOrientation)
_OTHERS = (ConfounderCount, Light, CameraPosition, CameraOrientation, Wording)
_ALL: tuple[type[Operator], ...] = (*_THINGS, *_OTHERS, *EXTRA_KINDS)
OPERATORS = {kind.name: kind for kind in _ALL}
