"""The simulator as one's own loop drives it, ``Stepped``."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.conditions import Conditions
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.sim.env import make_env
from vlafuzz.worlds.tabletop.sim.evaluator import proprioception
from vlafuzz.worlds.tabletop.state import State, StateMonitor

CAMERA = "image"


class SteppedTable:
    """A table with a robot under the conditions of a run; see ``Stepped``."""

    def __init__(self, run: Conditions, catalogue: Catalogue, robot: str, size: int, hz: int) -> None:
        cameras = (CameraRequest(CAMERA, size, size),) if size else ()
        self._env = make_env(run.task, catalogue, cameras, hz, robot, run.placement)
        self.most_steps = self._env.rig.seconds * self._env.control_hz

    @property
    def monitor(self) -> StateMonitor:
        monitor: StateMonitor = self._env.monitor
        return monitor

    def begin(self, scene: Scene) -> None:
        self._state: State = self._env.begin(scene)

    def advance(self, action: NDArray[Any]) -> None:
        self._state = self._env.advance(action, "current")

    def proprioception(self) -> NDArray[np.float32]:
        return proprioception(self._state, self._env.rig.opening)

    def seen(self) -> NDArray[np.uint8]:
        picture: NDArray[np.uint8] = self._env.seen(CAMERA)
        return picture

    def picture(self) -> NDArray[np.uint8]:
        picture: NDArray[np.uint8] = self._env.picture(CAMERA)
        return picture

    def close(self) -> None:
        self._env.close()
