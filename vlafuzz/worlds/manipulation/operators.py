"""The scene operators: what each varies, in which ranges, and its genes in a task."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from vlafuzz.model import scene as model
from vlafuzz.model.genes import Gene, Grid
from vlafuzz.model.scene import Pattern, TablePaint, WallPaint, amount, in_words
from vlafuzz.worlds.manipulation.base import Box, Layout, Number, Operator, Range, Span, Step, check_levels
from vlafuzz.worlds.manipulation.rigs import Rig

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
    def _has_spots(self) -> _Position:
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
    def _ordered(self) -> ConfounderCount:
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
    def _positive(self) -> Light:
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
    def _not_negative(self) -> CameraPosition:
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


Options = Span | tuple[str, ...]


class Extra(Operator):
    """An operator that is off by default. Its fields are ranges or options of the part's fields of that name.

    Nominal is the default of the part's field. While the operator does not vary, digests of operator sets and stored
    operators leave it out; a file that leaves it out gets the ranges of ``tabletop.yaml``.
    """

    def spans(self, rig: Rig) -> Mapping[str, Options]:
        """The range of each field that this rig has."""
        return dict(self)

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for field, span in self.spans(layout.rig).items():
            path, nominal = f"{self.part}.{field}", self._nominal(field)
            if isinstance(span, Span):
                yield self._gene(path, "real", span.grid(nominal))
            else:
                grid = Grid.choice(len(span), span.index(nominal))
                yield Gene(self.name, path, "category", grid, options=span)

    def nominally(self) -> str:
        return ", ".join(in_words(field, self._nominal(field)) for field, _ in self)

    def ranges(self) -> str:
        return ", ".join(
            f"{field} {span.low:g} to {amount(field, span.high)}"
            if isinstance(span, Span)
            else f"{field} {' or '.join(span)}"
            for field, span in self
        )

    @model_validator(mode="after")
    def _has_nominal(self) -> Extra:
        for field, span in self:
            nominal = self._nominal(field)
            if not (span.holds(nominal) if isinstance(span, Span) else nominal in span):
                raise ValueError(f"{field} does not include {nominal}, its nominal value")
            if isinstance(nominal, int) and isinstance(span, Span) and span.step % 1:
                raise ValueError(f"{field} is a whole number, its step is {span.step:g}")
        return self

    def _nominal(self, field: str) -> Any:
        return getattr(model.EXTRAS[self.part], field)


class Backdrop(Extra):
    """The looks of the table top and of the wall behind the robot."""

    name, says, part = "backdrop", "what table and wall look like", "backdrop"
    table: tuple[Pattern, ...] = Field(strict=False)
    colour: tuple[TablePaint, ...] = Field(strict=False)
    wall: tuple[WallPaint, ...] = Field(strict=False)


class InitialPose(Extra):
    """The offset of each of the robot's arm joints from its usual position at the start, degrees."""

    name, says, part = "initial-pose", "how the arm is bent at the start", "initial_pose"
    j1: Span
    j2: Span
    j3: Span
    j4: Span
    j5: Span
    j6: Span
    j7: Span

    def spans(self, rig: Rig) -> Mapping[str, Options]:
        return dict(list(self)[: rig.arm_joints])


class SensorNoise(Extra):
    """Blur, noise and compression of the images that the policy sees."""

    name, says, part = "sensor-noise", "blur, noise and compression of images", "noise"
    blur: Span
    grain: Span
    jpeg: Span


class ControlLatency(Extra):
    """The delay of the policy's actions, control steps."""

    name, says, part = "control-latency", "how late actions are executed", "latency"
    delay: Span


class InitialState(Extra):
    """The number of the task's own initial state from which a scene deviates, where the world has several."""

    name, says, part = "initial-state", "which of the task's own initial states it is", "start"
    state: Span

    def genes(self, layout: Layout) -> Iterator[Gene]:
        if layout.rig.initial_states > 1:
            last = min(int(self.state.high), layout.rig.initial_states - 1)
            yield self._gene(f"{self.part}.state", "category", Grid.choice(last + 1))


class _Bystander(Extra):
    """An operator of what stands in a task's own states and the task is not about, as offsets from there.

    A world that has such things makes the genes.
    """

    part = "targets"

    def genes(self, layout: Layout) -> Iterator[Gene]:
        yield from ()

    def _nominal(self, field: str) -> float:
        return 0.0


class BystanderPosition(_Bystander):
    """The offset of those things from their places in the task's own states."""

    name, says = "bystander-position", "where the task's own things stand that it is not about"
    x: Span
    y: Span


class BystanderOrientation(_Bystander):
    """The turn of those things from their orientation in the task's own states."""

    name, says = "bystander-orientation", "how the task's own things are turned that it is not about"
    yaw: Span


class EventOperator(Extra):
    """Something that happens in the middle of an episode: when, and how much; nominally it does not.

    Nothing is more severe in the moment or in the direction of an event, only in its size.
    """

    happens: ClassVar[str]  # what happens, in a clause that goes on with how much
    slot: ClassVar[int] = 0  # of the target that is concerned: a task with fewer has no such event
    when: tuple[model.Moment, ...] = Field(strict=False, min_length=1)

    def genes(self, layout: Layout) -> Iterator[Gene]:
        if self.slot < len(layout.of("targets")):
            for gene in super().genes(layout):
                if gene.path.endswith(".direction"):
                    yield replace(gene, kind="angle", grid=replace(gene.grid, wraps=True), neutral=True)
                else:
                    yield replace(gene, neutral=gene.kind == "category")

    def nominally(self) -> str:
        return "never"


class TargetSlide(EventOperator):
    """The first target is slid over the table."""

    name, says, part = "target-slide", "how far the target is slid in mid-episode", "target_slide"
    happens = "the target slides away"
    distance: Span
    direction: Span


class GoalSlide(EventOperator):
    """The second target, to which the first one is brought, is slid over the table."""

    name, says, part, slot = "goal-slide", "how far the second target is slid in mid-episode", "goal_slide", 1
    happens = "the second target slides away"
    distance: Span
    direction: Span


class CameraBump(EventOperator):
    """The camera is turned."""

    name, says, part = "camera-bump", "how far the camera is turned in mid-episode", "camera_bump"
    happens = "the camera is turned"
    roll: Span
    pitch: Span
    yaw: Span


class LightSwitch(EventOperator):
    """All lights become brighter or darker by a factor, stepped in log2."""

    name, says, part = "light-switch", "a factor on all lights in mid-episode", "light_switch"
    happens = "the light changes"
    intensity: Span

    def genes(self, layout: Layout) -> Iterator[Gene]:
        when, intensity = super().genes(layout)
        yield when
        yield replace(intensity, grid=replace(intensity.grid, log=True))


class PictureLoss(EventOperator):
    """The policy's pictures freeze, or turn black, for some control steps."""

    name, says, part = "picture-loss", "for how long the policy sees nothing new", "picture_loss"
    happens = "the pictures stop"
    duration: Span
    shows: tuple[Literal["frozen", "black"], ...] = Field(strict=False, min_length=1)


class ControlStall(EventOperator):
    """The robot stands still, and commands are lost, for some control steps."""

    name, says, part = "control-stall", "for how long the robot stands still in mid-episode", "control_stall"
    happens = "the robot stands still"
    duration: Span


class GripSlip(EventOperator):
    """The fingers open for some control steps."""

    name, says, part = "grip-slip", "for how long the fingers open by themselves", "grip_slip"
    happens = "the fingers open"
    duration: Span


_EVENTS: tuple[type[EventOperator], ...] = (
    TargetSlide,
    GoalSlide,
    CameraBump,
    LightSwitch,
    PictureLoss,
    ControlStall,
    GripSlip,
)
_EXTRA: tuple[type[Extra], ...] = (
    Backdrop,
    InitialPose,
    SensorNoise,
    ControlLatency,
    InitialState,
    BystanderPosition,
    BystanderOrientation,
    *_EVENTS,
)
_ALL: tuple[type[Operator], ...] = (
    TargetType,
    TargetPosition,
    TargetOrientation,
    ConfounderType,
    ConfounderPosition,
    ConfounderOrientation,
    ConfounderCount,
    Light,
    CameraPosition,
    CameraOrientation,
    Wording,
    *_EXTRA,
)
OPERATORS = {kind.name: kind for kind in _ALL}
EXTRAS = frozenset(kind.name for kind in _EXTRA)
EVENTS = tuple(kind.name for kind in _EVENTS)
