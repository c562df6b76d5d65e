"""Stills: scenes as the third-person camera sees them before anything moves."""

from __future__ import annotations

from dataclasses import replace

import imageio.v3 as imageio

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.policies.base import CameraRequest
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.sim.maniskill.env import TabletopEnv
from vlafuzz.sim.maniskill.make import make_env


class Stills:
    """Takes pictures of scenes of one task, ``size`` pixels high."""

    def __init__(self, task: str, catalogue: Catalogue, size: int = 256, placement: str = "resting") -> None:
        self._task, self._catalogue, self._placement = task, catalogue, placement
        self._camera = CameraRequest("still", size, size)
        self._env: TabletopEnv | None = None

    def png(self, scene: Scene) -> bytes:
        """A picture of a fair scene.

        Raises:
            PrerequisiteError: nothing here can render.
        """
        if self._env is not None and self._env.rig.robot != scene.robot:
            self.close()
        if self._env is None:
            camera = replace(self._camera, width=rig(scene.robot).view.width(self._camera.height))
            self._env = make_env(
                self._task, self._catalogue, (camera,), robot=scene.robot, placement=self._placement
            )
        self._env.begin(scene)
        return imageio.imwrite("<bytes>", self._env.picture(self._camera.name), extension=".png")

    def close(self) -> None:
        """Let go of the simulator."""
        if self._env is not None:
            self._env.close()
            self._env = None
