"""The ManiSkill 3 environment of all four tasks, and the evaluator of a policy in it."""

import gc
from collections.abc import Collection, Sequence
from typing import Any

import cv2
import numpy as np
import sapien
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs.types import SceneConfig, SimConfig

from vlafuzz.common.arrays import Picture
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model import Backdrop, Rejection, Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.sight import CameraPose
from vlafuzz.worlds.tabletop.evaluator import TabletopEvaluator
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.room import WRIST_CAMERA, Room
from vlafuzz.worlds.tabletop.sim import rendering
from vlafuzz.worlds.tabletop.sim.robots import AGENTS
from vlafuzz.worlds.tabletop.sim.world import CONTACT_OFFSET, World, settled, substeps
from vlafuzz.worlds.tabletop.tasks import State


def sapien_pose(view: CameraPose) -> sapien.Pose:
    return sapien.Pose(view.position, view.quaternion)


class TabletopEnv(BaseEnv, Room):
    """A room that ManiSkill simulates and draws.

    Args:
        control_hz: control steps per second, a divisor of 100; ignored if the rig fixes its rate.
        robot: the name of a rig.
        full: the cameras whose pictures have shadows: see ``Studio``.

    Raises:
        PrerequisiteError: a robot's files are missing, or a renderer for the cameras.
    """

    SUPPORTED_ROBOTS = tuple(agent.uid for agent in AGENTS.values())
    agent: Any

    def __init__(
        self,
        task: str,
        catalogue: Catalogue,
        cameras: Sequence[CameraRequest] = (),
        control_hz: int = 5,
        robot: str = PANDA.robot,
        full: Collection[str] = (),
    ) -> None:
        self._full = full
        self._studios: dict[str, rendering.Studio] = {}
        self._requests = {request.name: request for request in cameras}
        Room.__init__(self, task, catalogue, robot, control_hz)
        try:
            BaseEnv.__init__(
                self,
                obs_mode="none",
                reward_mode="none",
                robot_uids=AGENTS[self.rig.urdf].uid,
                render_backend=rendering.render_backend() if cameras else "none",
            )
        except RuntimeError as error:
            if "rendering device" not in str(error):
                raise
            problem = f"pictures need a renderer: {error}"
            raise PrerequisiteError(problem, hint="`vlafuzz doctor` says what to install") from None
        gc.collect()
        gc.freeze()  # torch and ManiSkill are never freed; scanning them costs 5 % of a rollout

    def build(self, scene: Scene) -> State:
        start: State = self.world.begin(self.models, scene.placements, scene.initial_pose)
        self.scene.sub_scenes = [self.world.scene]
        self.scene.px = self.world.scene.physx_system
        self._painter.paint(scene.backdrop)
        if self.scene.can_render():
            self._lights.apply(self.world.scene, self.light)
            self.aim()
            for name in self._full:
                if name not in self._studios:
                    device = self.world.scene.render_system.device
                    self._studios[name] = rendering.Studio(device, self._render_camera(name), self.rig.lights)
                self._studios[name].begin(self.world.scene, self.light)
        return start

    def relight(self) -> None:
        if self.scene.can_render():
            self._lights.apply(self.world.scene, self.light)
        for studio in self._studios.values():
            studio.light(self.light)

    def measured(self) -> tuple[float, sapien.Pose, Backdrop]:
        light, camera = self.light, sapien_pose(self.view)
        if self.scene.can_render():
            light = self._lights.measure(self.world.scene)
            for name in self._third_person:
                camera = self._render_camera(name).local_pose
        return light, camera, self._painter.backdrop

    def camera(self, view: CameraPose) -> sapien.Pose:
        return sapien_pose(view)

    def picture(self, camera: str) -> Picture:
        request = self._requests[camera]
        if camera in self._studios:
            image = self._studios[camera].picture()
        else:
            self.world.scene.update_render()
            taking = self._render_camera(camera)
            taking.take_picture()
            image = taking.get_picture("Color")[..., :3]
        size = (request.width, request.height)
        if image.shape[1::-1] != size:  # a view that is not square is rendered whole, then squeezed to the request
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return image

    def _render_camera(self, name: str) -> sapien.render.RenderCameraComponent:
        return self.scene.sensors[name].camera._render_cameras[0]

    def aim(self) -> None:
        for name in self._third_person:
            self.scene.sensors[name].camera.set_local_pose(sapien_pose(self.view))

    @property
    def _third_person(self) -> list[str]:
        return [name for name, request in self._requests.items() if request.role == "third_person"]

    # Called by ManiSkill

    @property
    def _default_sim_config(self) -> SimConfig:
        physics_hz, scene = substeps(self.rig, self.control_hz)[1], SceneConfig(contact_offset=CONTACT_OFFSET)
        return SimConfig(sim_freq=physics_hz, control_freq=self.control_hz, scene_config=scene)

    @property
    def _default_sensor_configs(self) -> list[CameraConfig]:
        """The requested cameras, at their nominal poses."""
        view, configs = self.rig.view, []
        for name, request in self._requests.items():
            pose, width, fov, mount = sapien.Pose(*WRIST_CAMERA), request.width, np.pi / 2, None
            if request.role == "third_person":
                pose, fov = sapien_pose(camera_pose(view)), np.radians(view.fov)
                width = width if view.aspect == 1 else view.width(request.height)
            elif self.agent.wrist is None:
                raise UsageError(f"{self.rig.robot}: it has no wrist camera", hint="ask for third_person only")
            else:
                mount = self.agent.robot.links_map[self.agent.wrist]
            shaders = rendering.use_shaders()
            configs.append(CameraConfig(name, pose, width, request.height, fov, mount=mount, shader_config=shaders))
        return configs

    def _load_agent(self, options: dict[str, Any]) -> None:
        super()._load_agent(options, sapien.Pose(self.rig.base))

    def _load_scene(self, options: dict[str, Any]) -> None:
        rendering.add_table(self.scene.sub_scenes[0], self.rig.table)
        self._painter = rendering.BackdropPainter(self.scene.sub_scenes[0])

    def _load_lighting(self, options: dict[str, Any]) -> None:
        self._lights = rendering.SceneLights(self.scene.sub_scenes[0], self.rig.lights)

    def _after_reconfigure(self, options: dict[str, Any]) -> None:
        self.world = World(self.scene.sub_scenes[0], self.agent, self.rig, self.control_hz)


class ManiSkillEvaluator(TabletopEvaluator):
    """Runs a policy in scenes of one task on ManiSkill."""

    def room(self, cameras: Sequence[CameraRequest], hz: int, robot: str, full: Collection[str]) -> TabletopEnv:
        return TabletopEnv(self._task.name, self.catalogue, cameras, hz, robot, full)

    @staticmethod
    def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
        return settled(scene, catalogue)
