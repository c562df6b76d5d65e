"""The extra operators: what each varies beside the paper's ten. They are off by default."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field, model_validator

from vlafuzz.model.genes import Gene, Grid
from vlafuzz.model.scene import EXTRAS, Pattern, TablePaint, WallPaint, amount, in_words
from vlafuzz.worlds.manipulation.base import Layout, Operator, Span
from vlafuzz.worlds.manipulation.rigs.rig import Rig

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
        return getattr(EXTRAS[self.part], field)


class Backdrop(Extra):
    """What the table top and the wall behind the robot look like."""

    name, says, part = "backdrop", "what table and wall look like", "backdrop"
    table: tuple[Pattern, ...] = Field(strict=False)
    colour: tuple[TablePaint, ...] = Field(strict=False)
    wall: tuple[WallPaint, ...] = Field(strict=False)


class InitialPose(Extra):
    """How far each of the arm's joints is from its usual position at the start: as many as the robot has."""

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
    """How blurred, noisy and compressed the images are that the policy sees."""

    name, says, part = "sensor-noise", "blur, noise and compression of images", "noise"
    blur: Span
    grain: Span
    jpeg: Span


class ControlLatency(Extra):
    """How many control steps late the policy's actions are executed."""

    name, says, part = "control-latency", "how late actions are executed", "latency"
    delay: Span


class InitialState(Extra):
    """From which of the task's own initial states a scene deviates, where the world has several."""

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
    """How far those things are from where they are in the task's own states."""

    name, says = "bystander-position", "where the task's own things stand that it is not about"
    x: Span
    y: Span


class BystanderOrientation(_Bystander):
    """How far those things are turned from how they stand in the task's own states."""

    name, says = "bystander-orientation", "how the task's own things are turned that it is not about"
    yaw: Span


ALL: tuple[type[Extra], ...] = (
    Backdrop,
    InitialPose,
    SensorNoise,
    ControlLatency,
    InitialState,
    BystanderPosition,
    BystanderOrientation,
)
