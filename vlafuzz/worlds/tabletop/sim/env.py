"""The ManiSkill 3 environment of all four tasks, which builds a scene and reports what the simulator contains then."""

import gc
import math
from collections.abc import Sequence
from dataclasses import astuple, replace
from typing import Any

import cv2
import numpy as np
import sapien
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs.types import SceneConfig, SimConfig

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import PrerequisiteError, SimulatorError, UsageError
from vlafuzz.model import scene as kinds
from vlafuzz.model.scene import EVENTS, EXTRAS, Event, Scene, Start
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.episode import DelayedCommands, SensorNoise
from vlafuzz.worlds.events import NUMBERS, STOP, Events, afterwards, cancelled, turned
from vlafuzz.worlds.manipulation.camera import CameraPose, camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA, rig
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.sim import rendering
from vlafuzz.worlds.tabletop.sim.robots import AGENTS, CONTROL_MODE
from vlafuzz.worlds.tabletop.sim.world import CONTACT_OFFSET, World, models_of, place, substeps
from vlafuzz.worlds.tabletop.tasks import State, StateMonitor, load_wordings, looked_at, say
from vlafuzz.worlds.tabletop.tasks import task as task_named

# In the hand's frame: in front of the palm, 5 cm off its middle, looking along the fingers.
WRIST_CAMERA = ((0.05, 0.0, 0.03), (0.0, 0.5**0.5, 0.0, 0.5**0.5))
METRES = 1e-5
TURN = 1e-4  # of a quaternion's components


def sapien_pose(view: CameraPose) -> sapien.Pose:
    return sapien.Pose(view.position, view.quaternion)


def _alike(expected: Any, actual: Any) -> bool:
    """Whether two parts of scenes are equal up to the simulator's single precision."""
    return all(
        one == other if isinstance(one, str) else math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-4)
        for one, other in zip(astuple(expected), astuple(actual), strict=True)
    )


def _check_pose(name: str, expected: sapien.Pose, actual: sapien.Pose) -> None:
    distance = float(np.abs(expected.p - actual.p).max())
    turn = float(min(np.abs(expected.q - actual.q).max(), np.abs(expected.q + actual.q).max()))
    if not (distance <= METRES and turn <= TURN):
        _fail(f"pose of {name}", expected, actual)


def _fail(part: str, expected: object, actual: object) -> None:
    raise SimulatorError(f"{part}: asked for {expected}, the simulator has {actual}", hint="this is a bug in vlafuzz")


class TabletopEnv(BaseEnv):
    """A robot at a table with one scene at a time.

    Args:
        control_hz: control steps per second, a divisor of 100; ignored if the rig fixes its rate.
        robot: the name of a rig.
        shown: the camera whose pictures are for people, with shadows: see ``Studio``.

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
        shown: str | None = None,
    ) -> None:
        self._shown = shown
        self._studio: rendering.Studio | None = None
        self.task = task_named(task)
        self.rig = rig(robot)
        self.catalogue = catalogue
        self._requests = {request.name: request for request in cameras}
        self.control_hz = self.rig.control_hz or control_hz
        try:
            super().__init__(
                obs_mode="none",
                reward_mode="none",
                robot_uids=AGENTS[self.rig.urdf].uid,
                control_mode=CONTROL_MODE,
                render_backend=rendering.render_backend() if cameras else "none",
            )
        except RuntimeError as error:
            if "rendering device" not in str(error):
                raise
            problem = f"pictures need a renderer: {error}"
            raise PrerequisiteError(problem, hint="`vlafuzz doctor` says what to install") from None
        gc.collect()
        gc.freeze()  # torch and ManiSkill are never freed; scanning them costs 5 % of a rollout

    def begin(self, scene: Scene, seed: int = 0) -> State:
        """Build a scene for a rollout with this seed; the state at its start."""
        self.models = models_of(scene.placements, self.catalogue)
        start = self.world.begin(self.models, scene.placements, scene.initial_pose)
        self.scene.sub_scenes = [self.world.scene]
        self.scene.px = self.world.scene.physx_system
        self._scene, self.instruction = scene, scene.instruction
        self.view = camera_pose(self.rig.view, scene.camera)
        self.light, self.table_colour = scene.light.intensity, self._painter.paint(scene.backdrop)
        if self.scene.can_render():
            self._lights.apply(self.world.scene, self.light)
            self._aim()
            if self._studio is None and self._shown is not None:
                device = self.world.scene.render_system.device
                self._studio = rendering.Studio(device, self._render_camera(self._shown))
            if self._studio is not None:
                self._studio.begin(self.world.scene, self.light)
        self._step, self._noise = 0, SensorNoise(scene.noise, seed)
        self._commands = DelayedCommands(scene.latency)
        self.monitor = StateMonitor(self.task, self.models, start)
        self._events = Events(scene, self.control_hz, self.task.stage_names)
        return start

    def advance(self, action: Array, relative_to: str = "target") -> State:
        """Execute a metric action for one control step (see ``MetricArm``); the state after it."""
        events, slides = self._events, None
        if events.parts:
            for event in events.begin(self._step, self.monitor.progress):
                self._happen(event)
            slides = events.slides()
        command, relative_to = self._commands.exchange(action, relative_to)
        state = self.world.step(events.executed(command), relative_to, slides)
        self.monitor.observe(state)
        self._step += 1
        return state

    def _happen(self, event: Event) -> None:
        """What begins with an event, and stays."""
        if isinstance(event, kinds.CameraBump):
            self.view = camera_pose(self.rig.view, turned(self._scene.camera, event))
            self._aim()
        elif isinstance(event, kinds.LightSwitch):
            self.light *= event.intensity
            if self.scene.can_render():
                self._lights.apply(self.world.scene, self.light)
            if self._studio is not None:
                self._studio.light(self.light)
        elif isinstance(event, kinds.TargetTopple):
            fallen = replace(self._scene.targets[0], rest=event.rest)
            (model,) = models_of([fallen], self.catalogue)
            self.world.topple(place(model, fallen))
        elif isinstance(event, kinds.GripWeak):
            self.world.controller.grip(event.force)
        elif isinstance(event, kinds.InstructionChange) and event.to == STOP:
            self.instruction, left = STOP, self.rig.seconds * self.control_hz - self._step
            self.monitor.cancel(cancelled(self.task.stages, looked_at, self.control_hz, left))
        elif isinstance(event, kinds.InstructionChange):
            self.models = models_of(afterwards(self._scene).placements, self.catalogue)
            self.instruction = say(load_wordings()[self.task.name][0], [model.spoken for model in self.models])
            start = self.world.exchange(self.task.targets - 1 + NUMBERS[event.to])
            self.monitor.begin_anew(self.models, start)

    def seen(self, camera: str) -> Picture:
        """``(height, width, 3)``: what a policy sees through a camera at present."""
        shown = self._noise.degraded(self.picture(camera), self._step, camera)
        return self._events.shown(camera, shown) if self._events.parts else shown

    def picture(self, camera: str) -> Picture:
        """``(height, width, 3)``: what a camera shows at present."""
        request = self._requests[camera]
        if self._studio is not None and camera == self._shown:
            image = self._studio.picture()
        else:
            self.world.scene.update_render()
            taking = self._render_camera(camera)
            taking.take_picture()
            image = taking.get_picture("Color")[..., :3]
        size = (request.width, request.height)
        if image.shape[1::-1] != size:  # a view that is not square is rendered whole, then squeezed to the request
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return image

    def check(self, scene: Scene) -> None:
        """Read the simulator back before the first step; a SimulatorError if it does not contain this scene."""
        names, built = [thing.object for thing in scene.placements], [model.name for model in self.models]
        if names != built:
            _fail("objects", names, built)
        models = models_of(scene.placements, self.catalogue)
        for model, placement, pose in zip(models, scene.placements, self.world.poses, strict=True):
            _check_pose(placement.object, place(model, placement), pose)
        light, camera = self.light, sapien_pose(self.view)
        if self.scene.can_render():
            light = self._lights.measure(self.world.scene)
            for name in self._third_person:
                camera = self._render_camera(name).local_pose
        if abs(light - scene.light.intensity) > 1e-4 * scene.light.intensity:
            _fail("light", scene.light.intensity, light)
        _check_pose("camera", sapien_pose(camera_pose(self.rig.view, scene.camera)), camera)
        in_effect = {
            "backdrop": self._painter.backdrop,
            "initial_pose": self.world.initial_pose,
            "noise": self._noise.noise,
            "latency": self._commands.latency,
            "start": Start(),  # there is only one
            **EVENTS,
            **self._events.parts,
        }
        for part in EXTRAS:
            expected = getattr(scene, part)
            if part not in in_effect or not _alike(expected, in_effect[part]):
                _fail(part.replace("_", " "), expected, in_effect.get(part))

    def _render_camera(self, name: str) -> sapien.render.RenderCameraComponent:
        return self.scene.sensors[name].camera._render_cameras[0]

    def _aim(self) -> None:
        for name in self._third_person:
            self.scene.sensors[name].camera.set_local_pose(sapien_pose(self.view))

    @property
    def _third_person(self) -> list[str]:
        return [name for name, request in self._requests.items() if request.role == "third_person"]

    # Called by ManiSkill

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(
            sim_freq=substeps(self.rig, self.control_hz)[1],
            control_freq=self.control_hz,
            scene_config=SceneConfig(contact_offset=CONTACT_OFFSET),
        )

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
            made = CameraConfig(
                name, pose, width, request.height, fov, mount=mount, shader_config=rendering.use_shaders()
            )
            configs.append(made)
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
