"""Latency: commands that reach the robot some control steps late."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.scene import Latency

Array = NDArray[np.float64]
Command = tuple[Array, str]  # a metric action, and what it is relative to; see ``ActionSpec``
_HOLD: Command = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), "target"  # stay, with the gripper open


class DelayedCommands:
    """Commands on their way to the robot, which holds still until the first one arrives."""

    def __init__(self, latency: Latency) -> None:
        self._commands: deque[Command] = deque([_HOLD] * latency.delay)

    @property
    def latency(self) -> Latency:
        """The delay of the next command."""
        return Latency(len(self._commands))

    def exchange(self, action: Array, relative_to: str) -> Command:
        """Send a command; return the one that arrives in its place."""
        self._commands.append((action, relative_to))
        return self._commands.popleft()
