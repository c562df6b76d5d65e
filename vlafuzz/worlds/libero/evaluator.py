"""LiberoEvaluator runs a policy in scenes of LIBERO, as the suites' own evaluations do."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Rejection
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import CameraRequest, Observation, Policy, PolicySpec
from vlafuzz.policies.harness import release
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.latency import DelayedCommands
from vlafuzz.worlds.libero.env import HZ, LiberoEnv
from vlafuzz.worlds.libero.expert import Expert
from vlafuzz.worlds.libero.expert.policy import UNITS
from vlafuzz.worlds.libero.pictures import CAMERAS, SAVINGS, Savings
from vlafuzz.worlds.libero.scenes.setting import VIEW, Setting
from vlafuzz.worlds.libero.scenes.space import nominal_scene
from vlafuzz.worlds.libero.shared import Workplace, close_idle, give_back, take
from vlafuzz.worlds.libero.stages import Moment, monitor_of
from vlafuzz.worlds.libero.stages import task as task_named
from vlafuzz.worlds.libero.suites import SETTLING
from vlafuzz.worlds.noise import SensorNoise
from vlafuzz.worlds.stepping import Evaluation

if TYPE_CHECKING:
    from vlafuzz.worlds.recording import Recording

Array = NDArray[np.float64]
SIDE = 256  # pixels of a picture in LIBERO's evaluations
OPENING = 0.08  # metres between the open fingers


@dataclass(frozen=True, eq=False)
class LiberoState:
    """What LIBERO's expert knows: everything."""

    env: LiberoEnv

    def plan(self, attempt: int, pace: int = 1) -> Iterator[Array]:
        """The expert's actions from the present state on, each for ``pace`` control steps."""
        return Expert(self.env, attempt, pace=pace).actions()


class LiberoEpisode(Episode):
    """Begins a rollout of a scene in an environment, after the suites' settling steps."""

    def __init__(
        self,
        setting: Setting,
        spec: PolicySpec,
        scene: Scene,
        seed: int,
        conditions: Conditions,
    ) -> None:
        env = setting.env
        self._env, self._spec = env, spec
        setting.begin(scene)
        env.settle(SETTLING)
        self._moment = Moment(env)
        self._substeps = HZ // spec.action.hz
        self._noise, self._commands = SensorNoise(scene.noise, seed), DelayedCommands(scene.latency)
        self._hash = hashlib.blake2b(env.state().tobytes(), digest_size=8)
        super().__init__(scene, seed, conditions, monitor_of(env), task_named(scene.task).stage_names)

    @property
    def hz(self) -> int:
        return self._spec.action.hz

    def observe(self) -> Observation:
        env, spec, step = self._env, self._spec, len(self.actions)
        return Observation(
            episode=self.start.episode,
            step=step,
            instruction=self.instruction,
            images={
                camera.name: self._noise.degraded(shown(env, camera), step, camera.name)
                for camera in spec.cameras
            },
            state=proprioception(env) if spec.state else None,
            fingers=env.proprioception()[6:].astype(np.float32) if spec.state else None,
            privileged=LiberoState(env) if spec.privileged else None,
        )

    def picture(self, camera: str) -> NDArray[np.uint8]:
        return self._env.picture(VIEW, self._env.size)[:, ::-1]  # upright for people, not turned by 180°

    def _horizon(self) -> int:
        return self._env.task.horizon // self._substeps

    def _execute(self, action: Array) -> None:
        due, _ = self._commands.exchange(action, self._spec.action.relative_to)
        own = due / UNITS
        own[:6] /= self._substeps
        for _ in range(self._substeps):
            self._env.step(own)
        self._hash.update(self._env.state().tobytes())
        self.monitor.observe(self._moment)

    def _states_hash(self) -> str:
        return self._hash.hexdigest()


def shown(env: LiberoEnv, camera: CameraRequest) -> NDArray[np.uint8]:
    """What a policy asks for, turned by 180°.

    As in evaluations of LIBERO, openpi's among them, pictures have 256 pixels a side, and are made smaller
    for models that take smaller ones.
    """
    picture = env.picture(CAMERAS[camera.role == "wrist"], max(camera.width, SIDE))
    if camera.width >= SIDE:
        return picture
    smaller = Image.fromarray(picture).resize((camera.width, camera.width), Image.Resampling.BILINEAR)
    return np.asarray(smaller)


def proprioception(env: LiberoEnv) -> NDArray[np.float32]:
    """``(7,)``: the hand's position (metres), rotation vector (radians), share of the fingers' opening."""
    own = env.proprioception()
    return np.array([*own[:6], (own[6] - own[7]) / OPENING], dtype=np.float32)


class LiberoEvaluator(SceneEvaluator):
    """Runs a policy in scenes of one task.

    Raises:
        UsageError: the policy asks for what LIBERO does not have.
    """

    def __init__(
        self,
        conditions: Conditions,
        policy: Policy,
        *,
        recording: Recording | None = None,
        checked: bool = True,
    ) -> None:
        stages = task_named(conditions.task).stage_names
        super().__init__(conditions, policy, stages, recording=recording, checked=checked)
        check_spec(policy.spec)
        self._workplace: Workplace | None = None
        self._robot = ""

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        try:
            return (yield from super().evaluation(scene, seed))
        finally:
            self._leave()

    def check(self, scene: Scene) -> Rejection | None:
        if scene.task != self._conditions.task:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._conditions.task!r}")
        return self._at(scene.robot).fairness.check(nominal_scene(scene.task, scene.robot), scene)

    def begin(self, scene: Scene, seed: int) -> LiberoEpisode:
        setting = self._at(scene.robot).environments.of(scene)
        return LiberoEpisode(setting, self._policy.spec, scene, seed, self._conditions)

    def renew(self) -> None:
        if self._workplace is not None:
            self._workplace.close()
            self._workplace = None
        close_idle()

    def close(self) -> None:
        self._leave()
        release(self._policy)

    def _leave(self) -> None:
        if self._workplace is not None:
            give_back(self._workplace)
            self._workplace = None

    def _at(self, robot: str) -> Workplace:
        """The environments with a variant of the robot."""
        if self._robot != robot:
            self._leave()
            self._robot = robot
        if self._workplace is None:
            cameras = [*self._policy.spec.cameras, *filter(None, [self.recorded])]
            size = max([SIDE, *(camera.width for camera in cameras)])
            self._workplace = take(self._conditions.task, size, savings_of(robot))
        return self._workplace


class LiberoStills:
    """Takes pictures of scenes of one task before anything moves, ``size`` pixels high."""

    def __init__(self, task: str, size: int = 256) -> None:
        self._task, self._size = task, size

    def png(self, scene: Scene) -> bytes:
        """A picture of a valid scene by the third-person camera."""
        workplace = take(self._task, self._size, savings_of(scene.robot))
        try:
            setting = workplace.environments.of(scene)
            setting.begin(scene)
            setting.env.settle(SETTLING)
            picture = setting.env.picture(VIEW, self._size)[:, ::-1]
        finally:
            give_back(workplace)
        return imageio.imwrite("<bytes>", picture, extension=".png")

    def close(self) -> None:
        """Nothing: the next evaluator may take the environments."""


def savings_of(robot: str) -> Savings:
    """What is left out of the pictures of a robot's variant."""
    return SAVINGS[robot.partition("-")[2] or "none"]


def check_spec(spec: PolicySpec) -> None:
    """Raise UsageError for a policy that asks for what LIBERO does not have."""
    if spec.silhouettes or spec.calibrated:
        problem = f"policy {spec.name!r} works on the tabletop only"
        raise UsageError(problem, hint="LIBERO gives pictures and the robot's state")
    if HZ % spec.action.hz:
        raise UsageError(
            f"policy {spec.name!r} acts {spec.action.hz} times a second, LIBERO {HZ} times or a part of it"
        )
    for camera in spec.cameras:
        if camera.width != camera.height:
            raise UsageError(
                f"camera {camera.name!r}: {camera.width} x {camera.height}, LIBERO's pictures are square"
            )
