"""A room that MuJoCo simulates and draws, and the evaluator of a policy in it."""

from collections.abc import Collection, Sequence

import mujoco
import numpy as np

from vlafuzz.common.arrays import Picture
from vlafuzz.model import Backdrop, Rejection, Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.events import STAY
from vlafuzz.worlds.manipulation.looks import GAMMA
from vlafuzz.worlds.opengl import Canvas
from vlafuzz.worlds.sight import CameraPose
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
        self._canvas: Canvas | None = None

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

    def measured(self) -> tuple[float, Placed, Backdrop]:
        camera = self.world.model.camera(CAMERA)
        return self.light, Placed(camera.pos.copy(), camera.quat.copy()), self._backdrop

    def camera(self, view: CameraPose) -> Placed:
        return Placed(view.position, looking(view.axes))

    def picture(self, camera: str) -> Picture:
        """All lights are scaled alike, so that a picture's linear light is scaled by as much; white is the most."""
        request = self._requests[camera]
        if self._canvas is None:
            sizes = zip(*((one.width, one.height) for one in self._requests.values()), strict=True)
            self._canvas = Canvas(self.world.model, *map(max, sizes))
            self._canvas.options.geomgroup[:] = np.arange(len(self._canvas.options.geomgroup)) == LOOKS
        self._canvas.look(CAMERA if request.role == "third_person" else WRIST)
        mujoco.mj_camlight(self.world.model, self.world.data)
        plain = self._canvas.draw(self.world.data, request.width, request.height)[::-1]
        bright: Picture = np.minimum(np.round(plain * self.light ** (1 / GAMMA)), 255).astype(np.uint8)
        return bright

    def close(self) -> None:
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None


class MujocoEvaluator(TabletopEvaluator):
    """Runs a policy in scenes of one task in MuJoCo."""

    def room(self, cameras: Sequence[CameraRequest], hz: int, robot: str, full: Collection[str]) -> MujocoRoom:
        return MujocoRoom(self._task.name, self.catalogue, cameras, hz)

    @staticmethod
    def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
        models, physics = models_of(scene.placements, catalogue), MujocoPhysics(round(1 / SECONDS))
        before = physics.begin(scene, models, touched=True)
        return unsettled(scene, models, before, physics.step(STAY))
