"""A room that MuJoCo simulates and draws, and the evaluator of a policy in it."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from vlafuzz.common.arrays import Picture
from vlafuzz.model import Backdrop, Rejection, Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.events import STAY
from vlafuzz.worlds.manipulation.camera import CameraPose
from vlafuzz.worlds.manipulation.looks import GAMMA
from vlafuzz.worlds.tabletop.evaluator import TabletopEvaluator
from vlafuzz.worlds.tabletop.fairness.checks import SECONDS, unsettled
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, models_of
from vlafuzz.worlds.tabletop.room import Room
from vlafuzz.worlds.tabletop.tasks import State
from vlafuzz.worlds.tabletop_mujoco.build import CAMERA, LOOKS, WRIST, looking
from vlafuzz.worlds.tabletop_mujoco.physics import MujocoPhysics, Placed


class MujocoRoom(Room):
    """A robot at a table with one scene at a time. Arguments as those of ``TabletopEnv``."""

    world: MujocoPhysics

    def __init__(
        self, task: str, catalogue: Catalogue, cameras: Sequence[CameraRequest] = (), control_hz: int = 5
    ) -> None:
        super().__init__(task, catalogue, "panda", control_hz)
        self.world = MujocoPhysics(self.control_hz)
        self._requests = {request.name: request for request in cameras}
        self._artist: Artist | None = None

    def build(self, scene: Scene) -> State:
        state = self.world.begin(scene, self.models)
        self._backdrop = scene.backdrop
        self.aim()
        self.close()
        return state

    def aim(self) -> None:
        camera = self.world.model.camera(CAMERA)
        camera.pos, camera.quat = self.camera(self.view)

    def relight(self) -> None:
        """Nothing: light is applied to the finished picture."""

    def measured(self) -> tuple[float, Placed]:
        camera = self.world.model.camera(CAMERA)
        return self.light, Placed(camera.pos.copy(), camera.quat.copy())

    def camera(self, view: CameraPose) -> Placed:
        return Placed(view.position, looking(view.axes))

    @property
    def backdrop(self) -> Backdrop:
        return self._backdrop

    def picture(self, camera: str) -> Picture:
        """All lights are scaled alike, so that a picture's linear light is scaled by as much; white is the most."""
        request = self._requests[camera]
        if self._artist is None:
            sizes = zip(*((one.width, one.height) for one in self._requests.values()), strict=True)
            self._artist = Artist(self.world.model, *map(max, sizes))
        name = CAMERA if request.role == "third_person" else WRIST
        plain = self._artist.draw(self.world.data, name, request.width, request.height)
        bright: Picture = np.minimum(np.round(plain * self.light ** (1 / GAMMA)), 255).astype(np.uint8)
        return bright

    def close(self) -> None:
        if self._artist is not None:
            self._artist.close()
            self._artist = None


class Artist:
    """Draws a MuJoCo model, in pictures of at most this width and height, by EGL: whatever MuJoCo would choose."""

    def __init__(self, model: Any, width: int, height: int) -> None:
        from mujoco.egl import GLContext

        self._model, self._gl = model, GLContext(width, height)
        self._gl.make_current()
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._scene, self._options = mujoco.MjvScene(model, maxgeom=1000), mujoco.MjvOption()
        self._options.geomgroup[:] = np.arange(len(self._options.geomgroup)) == LOOKS
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def draw(self, data: Any, camera: str, width: int, height: int) -> Picture:
        """``(height, width, 3)``: under the nominal light."""
        self._gl.make_current()
        self._camera.fixedcamid = self._model.camera(camera).id
        mujoco.mj_camlight(self._model, data)
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)
        picture, view = np.empty((height, width, 3), dtype=np.uint8), mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, self._scene, self._context)
        mujoco.mjr_readPixels(picture, None, view, self._context)
        return picture[::-1]

    def close(self) -> None:
        self._gl.make_current()
        self._context.free()
        self._gl.free()


class MujocoEvaluator(TabletopEvaluator):
    """Runs a policy in scenes of one task in MuJoCo."""

    def room(self, cameras: Sequence[CameraRequest], hz: int, robot: str, shown: str | None) -> MujocoRoom:
        return MujocoRoom(self._task.name, self.catalogue, cameras, hz)

    def settled(self, scene: Scene) -> Rejection | None:
        return settled(scene, self.catalogue)


def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
    """Why objects do not stay in place for a second, or the task is solved at once; None for a fair scene."""
    models, physics = models_of(scene.placements, catalogue), MujocoPhysics(round(1 / SECONDS))
    before = physics.begin(scene, models, touched=True)
    return unsettled(scene, models, before, physics.step(STAY))
