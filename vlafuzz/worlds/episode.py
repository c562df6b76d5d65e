"""Episode: one rollout of a policy in a scene, whatever the world."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Rollout
from vlafuzz.model.scene import Scene
from vlafuzz.model.task import Monitor
from vlafuzz.policies.base import EpisodeStart, Observation

AFTER_SUCCESS = 10  # control steps, to tell success at the end from success once


class Episode(ABC):
    """A rollout that has begun. The conditions define when it is over and what counts as success.

    Attributes:
        actions: so far, ``(7,)`` each, metric.
        monitor: of its stages.
    """

    def __init__(self, scene: Scene, seed: int, conditions: Conditions, monitor: Monitor) -> None:
        self.scene, self.monitor = scene, monitor
        self._after = 0 if conditions.stop_early else AFTER_SUCCESS
        self.start = EpisodeStart(f"{scene.digest}-{seed}", scene.instruction, scene.task, seed, scene.robot)
        self.actions: list[NDArray[np.float64]] = []
        self._last = self._horizon()

    @property
    def over(self) -> bool:
        return len(self.actions) >= self._last

    @property
    def success(self) -> bool:
        """Whether the task has been solved at any time."""
        return self.monitor.success_once

    @property
    def success_now(self) -> bool:
        """Whether the task is solved after the last step."""
        return self.monitor.success_now

    @property
    def instruction(self) -> str:
        """The current instruction, see ``Scene.instruction_at``."""
        return self.scene.instruction_at(len(self.monitor.reached))

    @property
    @abstractmethod
    def hz(self) -> int:
        """Control steps per second."""

    @abstractmethod
    def observe(self) -> Observation:
        """The present observation, with the parts that the policy's spec asks for."""

    @abstractmethod
    def picture(self, camera: str) -> NDArray[np.uint8]:
        """``(height, width, 3)``: what a camera shows at present, without noise."""

    def advance(self, action: NDArray[np.float64]) -> None:
        """Execute a metric action for one control step."""
        before = self.success
        self.actions.append(action)
        self._execute(action)
        if self.success and not before:
            self._last = min(self._last, len(self.actions) + self._after)

    def rollout(self, seconds: float = 0.0) -> Rollout:
        """The result of a rollout that took so many seconds."""
        monitor = self.monitor
        return Rollout(
            success_once=self.success,
            success_at_end=self.success_now,
            reached=tuple(monitor.reached),
            progress=1.0 if self.success else min(monitor.progress, 0.99),
            trace=monitor.trace,
            actions=np.array(self.actions, dtype=np.float32),
            states_hash=self._states_hash(),
            seconds=seconds,
        )

    @abstractmethod
    def _horizon(self) -> int:
        """Control steps after which a rollout without success ends."""

    @abstractmethod
    def _execute(self, action: NDArray[np.float64]) -> None:
        """Simulate a control step, and show its end to the monitor."""

    @abstractmethod
    def _states_hash(self) -> str:
        """A digest of all states so far."""
