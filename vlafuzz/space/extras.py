"""The extra operators: what each varies beside the paper's ten. They are off by default."""

from __future__ import annotations

from vlafuzz.space.base import Extra
from vlafuzz.space.ranges import Span


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


ALL: tuple[type[Extra], ...] = (SensorNoise, ControlLatency)
