"""The extra operators: what each varies beside the paper's ten. They are off by default."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from vlafuzz.rigs.rig import Rig
from vlafuzz.scene import Pattern, TablePaint, WallPaint
from vlafuzz.space.base import Extra, Options
from vlafuzz.space.ranges import Span


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
        return dict(list(super().spans(rig).items())[: rig.arm_joints])


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


ALL: tuple[type[Extra], ...] = (Backdrop, InitialPose, SensorNoise, ControlLatency)
