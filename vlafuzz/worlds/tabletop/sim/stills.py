"""Stills: pictures of scenes before anything moves."""

from dataclasses import replace

import imageio.v3 as imageio

from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv, make_env


class Stills:
    """Takes pictures of scenes of one task before anything moves, ``size`` pixels high."""

    def __init__(self, task: str, catalogue: Catalogue, size: int = 256, placement: str = "resting") -> None:
        self._task, self._catalogue, self._placement = task, catalogue, placement
        self._camera = CameraRequest("still", size, size)
        self._env: TabletopEnv | None = None

    def png(self, scene: Scene) -> bytes:
        """A picture of a valid scene by the third-person camera.

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
        if self._env is not None:
            self._env.close()
            self._env = None
