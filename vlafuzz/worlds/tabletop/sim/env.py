"""The ManiSkill 3 environment of all four tasks: ``VlaFuzz-PickUp-v1`` and so on in gymnasium.

``reset(options={"scene": Scene})`` builds that scene and reports in ``info["applied"]`` what the simulator contains.
vlafuzz itself uses ``begin`` and ``advance``: the same physics without gymnasium's batched tensors.
"""

import gc
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import gymnasium
import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SceneConfig, SimConfig
from numpy.typing import NDArray

from vlafuzz.errors import PrerequisiteError, SceneError, SimulatorError, suggestion
from vlafuzz.model.scene import EXTRAS, Scene, Start
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.disturbances import DelayedCommands, SensorNoise
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA, Rig, rig
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.sim.cameras import Cameras, sapien_pose
from vlafuzz.worlds.tabletop.sim.objects import CONTACT_OFFSET, models_of, place
from vlafuzz.worlds.tabletop.sim.rendering import SceneLights, render_backend
from vlafuzz.worlds.tabletop.sim.robots import AGENTS, CONTROL_MODE
from vlafuzz.worlds.tabletop.sim.table import BackdropPainter, add_table
from vlafuzz.worlds.tabletop.sim.world import Robot, World, substeps
from vlafuzz.worlds.tabletop.state import State, StateMonitor
from vlafuzz.worlds.tabletop.tasks import TASKS, default_scene
from vlafuzz.worlds.tabletop.tasks import task as task_named

METRES = 1e-5
TURN = 1e-4  # of a quaternion's components


@dataclass(frozen=True, eq=False, kw_only=True)
class Applied:
    """What the simulator contains, read back from it."""

    instruction: str
    objects: tuple[str, ...]
    poses: tuple[sapien.Pose, ...]
    light: float  # factor on the nominal lights
    camera: sapien.Pose
    extras: Mapping[str, Any]  # parts of the scene that extra operators vary, as far as they are in effect

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for ``info``."""
        return {
            "instruction": self.instruction,
            "objects": [
                {"name": name, "position": pose.p.tolist(), "quaternion": pose.q.tolist()}
                for name, pose in zip(self.objects, self.poses, strict=True)
            ],
            "light": self.light,
            "camera": {"position": self.camera.p.tolist(), "quaternion": self.camera.q.tolist()},
            **{part: asdict(value) for part, value in self.extras.items()},
        }

    def check(self, scene: Scene, models: Sequence[ObjectModel], rig: Rig) -> None:
        """SimulatorError if this is not the requested scene with these models, before the first step."""
        if self.objects != tuple(placement.object for placement in scene.placements):
            _fail("objects", [placement.object for placement in scene.placements], self.objects)
        for model, placement, actual in zip(models, scene.placements, self.poses, strict=True):
            _check_pose(placement.object, place(model, placement), actual)
        if abs(self.light - scene.light.intensity) > 1e-4 * scene.light.intensity:
            _fail("light", scene.light.intensity, self.light)
        _check_pose("camera", sapien_pose(camera_pose(rig.view, scene.camera)), self.camera)
        if self.instruction != scene.instruction:
            _fail("instruction", scene.instruction, self.instruction)
        for part in EXTRAS:
            expected, actual = getattr(scene, part), self.extras.get(part)
            if actual is None or not _alike(asdict(expected), asdict(actual)):
                _fail(part.replace("_", " "), expected, actual)


def _alike(expected: Mapping[str, Any], actual: Mapping[str, Any]) -> bool:
    """Whether two parts of scenes are equal up to the simulator's single precision."""
    return all(
        actual[field] == value
        if isinstance(value, str)
        else math.isclose(actual[field], value, rel_tol=1e-5, abs_tol=1e-4)
        for field, value in expected.items()
    )


def _check_pose(name: str, expected: sapien.Pose, actual: sapien.Pose) -> None:
    distance = float(np.abs(expected.p - actual.p).max())
    turn = float(min(np.abs(expected.q - actual.q).max(), np.abs(expected.q + actual.q).max()))
    if not (distance <= METRES and turn <= TURN):
        _fail(f"pose of {name}", expected, actual)


def _fail(part: str, expected: object, actual: object) -> None:
    raise SimulatorError(f"{part}: asked for {expected}, the simulator has {actual}", hint="this is a bug in vlafuzz")


EPISODE_SECONDS = PANDA.seconds
THIRD_PERSON = CameraRequest("third_person", 128, 128)
_OPTIONS = {"scene", "reconfigure", "env_idx"}


class TabletopEnv(BaseEnv):
    """A robot at a table with one scene at a time.

    Args:
        control_hz: control steps per second, a divisor of 100; ignored if the rig fixes its rate. robot: the name of a
        rig.
    """

    SUPPORTED_ROBOTS = tuple(agent.uid for agent in AGENTS.values())
    agent: Any

    def __init__(
        self,
        task: str = "pick-up",
        catalogue: Catalogue | None = None,
        cameras: Sequence[CameraRequest] = (THIRD_PERSON,),
        control_hz: int = 5,
        robot: str = "panda",
        **kwargs: Any,
    ) -> None:
        self.task = task_named(task)
        self.rig = rig(robot)
        self.catalogue = catalogue or load_catalogue()
        self._cameras = Cameras(self.rig, cameras, task)
        self.control_hz = self.rig.control_hz or control_hz
        kwargs.setdefault("robot_uids", AGENTS[self.rig.urdf].uid)
        kwargs.setdefault("control_mode", CONTROL_MODE)
        kwargs.setdefault("reward_mode", "sparse")
        super().__init__(**kwargs)

    def begin(self, scene: Scene, seed: int = 0) -> State:
        """Build a scene for a rollout with this seed; the state at its start."""
        self._scene_shown = scene
        self.models = models_of(scene.placements, self.catalogue)
        start = self.world.begin(self.models, scene.placements, scene.initial_pose)
        self.scene.sub_scenes = [self.world.scene]
        self.scene.px = self.world.scene.physx_system
        self.view = camera_pose(self.rig.view, scene.camera)
        self.light, self.table_colour = scene.light.intensity, self._painter.paint(scene.backdrop)
        if self.scene.can_render():
            self._lights.apply(self.world.scene, self.light)
            self._aim()
        self._step, self._noise = 0, SensorNoise(scene.noise, seed)
        self._commands = DelayedCommands(scene.latency)
        self.monitor = StateMonitor(self.task, self.models, start)
        return start

    def advance(self, action: NDArray[np.float64], relative_to: str = "target") -> State:
        """Execute a metric action for one control step (see ``MetricArm``); the state after it."""
        state = self.world.step(*self._commands.exchange(action, relative_to))
        self.monitor.observe(state)
        self._step += 1
        return state

    def seen(self, camera: str) -> NDArray[np.uint8]:
        """``(height, width, 3)``: what a policy sees through a camera at present."""
        return self._noise.degraded(self.picture(camera), self._step, camera)

    def picture(self, camera: str) -> NDArray[np.uint8]:
        """``(height, width, 3)``: what a camera shows at present."""
        self.world.scene.update_render()
        return self._cameras.picture(camera, self._render_camera(camera), self.world.visible)

    def applied(self) -> Applied:
        """What the simulator contains, read back from it."""
        third_person = self._cameras.third_person if self.scene.can_render() else []
        camera = self._render_camera(third_person[0]).local_pose if third_person else sapien_pose(self.view)
        return Applied(
            instruction=self._scene_shown.instruction,
            poses=self.world.poses,
            objects=tuple(model.name for model in self.models),
            light=self._lights.measure(self.world.scene) if self.scene.can_render() else self.light,
            camera=camera,
            extras={
                "backdrop": self._painter.backdrop,
                "initial_pose": self.world.initial_pose,
                "noise": self._noise.noise,
                "latency": self._commands.latency,
                "start": Start(),  # there is only one
            },
        )

    def _render_camera(self, name: str) -> sapien.render.RenderCameraComponent:
        return self.scene.sensors[name].camera._render_cameras[0]

    def _aim(self) -> None:
        third_person = [self.scene.sensors[name] for name in self._cameras.third_person]
        for camera in (*third_person, *self.scene.human_render_cameras.values()):
            camera.camera.set_local_pose(sapien_pose(self.view))

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
        return self._cameras.configs(self.agent)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        return self._cameras.human_config()

    def _load_agent(self, options: dict[str, Any]) -> None:
        super()._load_agent(options, sapien.Pose(self.rig.base))

    def _load_scene(self, options: dict[str, Any]) -> None:
        add_table(self.scene.sub_scenes[0], self.rig.table)
        self._painter = BackdropPainter(self.scene.sub_scenes[0])

    def _load_lighting(self, options: dict[str, Any]) -> None:
        self._lights = SceneLights(self.scene.sub_scenes[0], self.rig.lights)

    def _after_reconfigure(self, options: dict[str, Any]) -> None:
        agent = self.agent
        links = {name: link._objs[0] for name, link in agent.robot.links_map.items()}
        robot = Robot(
            articulation=agent.robot._objs[0],
            joints=tuple(agent.robot.active_joints_map),
            arm=agent.controller.arm,
            tcp=links[agent.tcp_name],
            fingers=tuple(tuple(links[name] for name in finger) for finger in agent.fingers),
            tool=agent.tool,
        )
        self.world = World(self.scene.sub_scenes[0], robot, self.rig, self.control_hz)

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict[str, Any]) -> None:
        scene = options.get("scene")
        if scene is None:
            scene = default_scene(self.task.name, self.catalogue)
        if not isinstance(scene, Scene):
            problem = f"options['scene']: expected a Scene, got {type(scene).__name__}"
            raise SceneError(problem, hint="Scene.from_json reads one")
        if scene.task != self.task.name:
            other = f"its task is {scene.task!r}, this environment's is {self.task.name!r}"
            raise SceneError(f"options['scene']: {other}")
        self.begin(scene)

    def reset(self, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Build ``options["scene"]``, or the nominal scene, and report it in ``info["applied"]``."""
        for key in set(options or {}) - _OPTIONS:
            raise SceneError(f"options: unknown key {key!r}", hint=suggestion(key, _OPTIONS))
        observation, info = super().reset(seed=seed, options=options)
        applied = self.applied()
        applied.check(self._scene_shown, self.models, self.rig)
        info["applied"] = applied.as_dict()
        return observation, info

    def _step_action(self, action: Any) -> torch.Tensor:
        metric = np.asarray(action, dtype=np.float64).reshape(-1)
        if metric.shape != (7,) or not np.all(np.isfinite(metric)):
            raise ValueError(f"expected 7 finite numbers as an action, got {metric}")
        self.advance(metric)
        return torch.as_tensor(metric, dtype=torch.float32)[None]

    def evaluate(self) -> dict[str, torch.Tensor]:
        """Stages, progress and success by both criteria, as ManiSkill's batched tensors."""
        monitor = self.monitor
        flags = {f"reached_{stage}": stage in monitor.reached for stage in self.task.stage_names[:-1]}
        flags |= {name: getattr(monitor, name) for name in ("success_once", "published_success")}
        numbers = flags | {"success": monitor.success_now, "progress": monitor.progress}
        return {name: torch.tensor([value]) for name, value in numbers.items()}

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, torch.Tensor]:
        return {"tcp_pose": self.agent.robot.links_map[self.agent.tcp_name].pose.raw_pose}


def make_env(
    task: str, catalogue: Catalogue, cameras: tuple[CameraRequest, ...] = (), control_hz: int = 5, robot: str = "panda"
) -> TabletopEnv:
    """A new environment. PrerequisiteError if a robot's files are missing, or a renderer for the cameras."""
    try:
        env = gymnasium.make(
            gym_id(task),
            catalogue=catalogue,
            cameras=cameras,
            control_hz=control_hz,
            robot=robot,
            obs_mode="none",
            render_backend=render_backend() if cameras else "none",
        )
    except RuntimeError as error:
        if "rendering device" not in str(error):
            raise
        raise PrerequisiteError(
            f"pictures need a renderer: {error}", hint="`vlafuzz doctor` says what to install"
        ) from None
    assert isinstance(env.unwrapped, TabletopEnv)
    gc.collect()
    gc.freeze()  # torch and ManiSkill are never freed; scanning them costs 5 % of a rollout
    return env.unwrapped


def gym_id(task: str) -> str:
    """The gymnasium id of a task: ``VlaFuzz-PickUp-v1`` for ``pick-up``."""
    return f"VlaFuzz-{''.join(part.title() for part in task.split('-'))}-v1"


for _name in TASKS:
    register_env(gym_id(_name), max_episode_steps=5 * EPISODE_SECONDS, task=_name, override=True)(TabletopEnv)
