"""The operators that are off by default: what a scene may have besides, and what happens in mid-episode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from vlafuzz.model import scene as model
from vlafuzz.model.genes import Gene, Grid
from vlafuzz.model.scene import Pattern, TablePaint, WallPaint, amount, in_words
from vlafuzz.worlds.manipulation.base import Layout, Operator, Span
from vlafuzz.worlds.manipulation.rigs import Rig

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


class GoalSlide(TargetSlide):
    """The second target, to which the first one is brought, is slid over the table."""

    name, says, part, slot = "goal-slide", "how far the second target is slid in mid-episode", "goal_slide", 1
    happens = "the second target slides away"


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


EVENT_KINDS: tuple[type[EventOperator], ...] = (
    TargetSlide,
    GoalSlide,
    CameraBump,
    LightSwitch,
    PictureLoss,
    ControlStall,
    GripSlip,
)
EXTRA_KINDS: tuple[type[Extra], ...] = (
    Backdrop,
    InitialPose,
    SensorNoise,
    ControlLatency,
    InitialState,
    BystanderPosition,
    BystanderOrientation,
    *EVENT_KINDS,
)
EXTRAS = frozenset(kind.name for kind in EXTRA_KINDS)
EVENTS = tuple(kind.name for kind in EVENT_KINDS)
