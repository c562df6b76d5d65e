"""LiberoEvaluator runs a policy in scenes of LIBERO as the suites' own evaluations do, in workplaces that it shares."""

import atexit
import hashlib
from functools import cached_property, partial
from typing import Unpack

import numpy as np
from PIL import Image

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import UsageError
from vlafuzz.model import Conditions, Monitor, Rejection, Scene
from vlafuzz.model.scene import InstructionChange
from vlafuzz.policies.base import CameraRequest, Observation, Policy, PolicySpec
from vlafuzz.policies.harness import release
from vlafuzz.worlds.episode import DelayedCommands, Episode, SensorNoise
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.events import STOP, Events, cancelled
from vlafuzz.worlds.libero.casts import cast, pool
from vlafuzz.worlds.libero.env import HZ, UNITS, LiberoEnv
from vlafuzz.worlds.libero.fairness import Fairness
from vlafuzz.worlds.libero.grasps import triangles
from vlafuzz.worlds.libero.pictures import CAMERAS, QUALITY, shrink
from vlafuzz.worlds.libero.setting import VIEW, Setting
from vlafuzz.worlds.libero.stages import Moment, find_stages, looked_at, task as task_named
from vlafuzz.worlds.libero.suites import SETTLING, find_task
from vlafuzz.worlds.manipulation.camera import exposed
from vlafuzz.worlds.manipulation.rigs import FORMER
from vlafuzz.worlds.sight import Sight

SIDE = 256  # pixels of a picture in LIBERO's evaluations
OPENING = 0.08  # metres between the open fingers
IDLE = 2  # workplaces that are kept for the next evaluator: each takes seconds and hundreds of megabytes


class LiberoEpisode(Episode):
    """A rollout of a scene in an environment. It begins after the suites' settling steps."""

    def __init__(self, setting: Setting, spec: PolicySpec, scene: Scene, seed: int, conditions: Conditions) -> None:
        self._env, self._spec = setting.env, spec
        setting.begin(scene)
        self._env.settle(SETTLING)
        self._moment = Moment(self._env)
        self._substeps, self._instruction = HZ // spec.action.hz, scene.instruction
        self._setting, self._events = setting, Events(scene, spec.action.hz, task_named(scene.task).stage_names)
        self._noise, self._commands = SensorNoise(exposed(scene).noise, seed), DelayedCommands(scene.latency)
        self.states_hash = hashlib.blake2b(self._env.state().tobytes(), digest_size=8)
        task, hz = self._env.task, spec.action.hz
        monitor = Monitor(find_stages(task))
        super().__init__(scene, seed, conditions, monitor, hz=hz, horizon=task.horizon // self._substeps)

    def observe(self) -> Observation:
        """The present observation; its privileged part is the ``LiberoEnv``."""
        env, spec = self._env, self._spec
        state = fingers = None
        if spec.state:
            own = env.proprioception()
            state = np.array([*own[:6], (own[6] - own[7]) / OPENING], np.float32)
            fingers = own[6:].astype(np.float32)
        return Observation(
            episode=self.start.episode,
            step=len(self.actions),
            instruction=self._instruction,
            images={camera.name: self._seen(camera) for camera in spec.cameras},
            state=state,
            fingers=fingers,
            privileged=env if spec.privileged else None,
        )

    def _seen(self, camera: CameraRequest) -> Picture:
        shown = self._noise.degraded(_shown(self._env, camera), len(self.actions), camera.name)
        return self._events.shown(camera.name, shown) if self._events.parts else shown

    def picture(self, camera: str) -> Picture:
        return self._env.picture(VIEW, self._env.size)[:, ::-1]  # upright for people, not turned by 180°

    def sight(self) -> Sight:
        env = self._env
        bodies = {name: (env.place(name), env.turn(name)) for name in env.movable}
        return Sight(self._setting.view, env.proprioception()[:3], bodies)

    def shape(self, body: str) -> tuple[Array, Array]:
        """Those of the shapes that collide, in grey."""
        env = self._env
        shapes = np.concatenate([triangles(env, int(geom)) for geom in env.away.shapes[body]])
        return (shapes - env.place(body)) @ env.turn(body), np.full(3, 0.6)

    def _execute(self, action: Array) -> None:
        due, _ = self._commands.exchange(action, self._spec.action.relative_to)
        events, slides = self._events, dict[int, Array]()
        if events.parts:
            for event in events.begin(
                len(self.actions) - 1, self.monitor.progress, partial(self._setting.let_in, self.scene)
            ):
                self._setting.happen(self.scene, event)
                if isinstance(event, InstructionChange) and event.to == STOP:
                    self._instruction, left = STOP, self._last - len(self.actions) + 1
                    self.monitor.cancel(cancelled(self.monitor.stages, looked_at, self.hz, left))
                elif isinstance(event, InstructionChange):
                    self._instruction, self._moment = self._env.task.instruction, Moment(self._env)
                    self.monitor.begin_anew()
            due, slides = events.executed(due), events.slides()
        own = due / UNITS
        own[:6] /= self._substeps
        for _ in range(self._substeps):
            for slot, shift in slides.items():
                self._setting.slide(slot, shift / self._substeps)
            self._env.step(own)
        self.states_hash.update(self._env.state().tobytes())
        self.monitor.observe(self._moment)


def _shown(env: LiberoEnv, camera: CameraRequest) -> Picture:
    """The picture for a policy, turned by 180°: of 256 pixels a side, as LIBERO evaluates, or reduced from these."""
    picture = env.picture(CAMERAS[camera.role == "wrist"], max(camera.width, SIDE))
    if camera.width >= SIDE:
        return picture
    smaller = Image.fromarray(picture).resize((camera.width, camera.width), Image.Resampling.BILINEAR)
    return np.asarray(smaller)


class LiberoEvaluator(SceneEvaluator):
    """Runs a policy in scenes of one task; a UsageError if it asks for what LIBERO does not have."""

    def __init__(self, conditions: Conditions, policy: Policy, **options: Unpack[Options]) -> None:
        super().__init__(conditions, policy, task_named(conditions.task).stage_names, **options)
        _check_spec(policy.spec)
        self._workplace: Workplace | None = None

    def check(self, scene: Scene) -> Rejection | None:
        if scene.task != self._conditions.task:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._conditions.task!r}")
        return self._at(scene).fairness.check(scene)

    def begin(self, scene: Scene, seed: int) -> LiberoEpisode:
        return LiberoEpisode(self._at(scene).of(scene), self._policy.spec, scene, seed, self._conditions)

    def renew(self) -> None:
        if self._workplace is not None:
            self._workplace.close()
            self._workplace = None
        close_idle()

    def close(self) -> None:
        self.leave()
        release(self._policy)

    def leave(self) -> None:
        if self._workplace is not None:
            give_back(self._workplace)
            self._workplace = None

    def _at(self, scene: Scene) -> "Workplace":
        """The workplace for a scene: that of the check is that of the rollout."""
        cameras = [*self._policy.spec.cameras, *filter(None, [self.recorded])]
        # pictures of robots that stored scenes may have were cheaper
        quality = "fast" if scene.robot in FORMER else QUALITY.of(self._conditions)
        key = scene.task, max([SIDE, *(camera.width for camera in cameras)]), quality
        if self._workplace is None or self._workplace.key != key:
            self.leave()
            self._workplace = take(*key)
        return self._workplace


def _check_spec(spec: PolicySpec) -> None:
    if spec.silhouettes or spec.calibrated:
        problem = f"policy {spec.name!r} works on the tabletop only"
        raise UsageError(problem, hint="LIBERO gives pictures and the robot's state")
    if HZ % spec.action.hz:
        raise UsageError(f"policy {spec.name!r} acts {spec.action.hz} times a second, LIBERO {HZ} or a part of it")
    for camera in spec.cameras:
        if camera.width != camera.height:
            raise UsageError(f"camera {camera.name!r}: {camera.width} x {camera.height}, LIBERO's pictures are square")


class Workplace:
    """A task's own environment, bit by bit LIBERO's, and one that also has what may be added.

    They are built when first needed. ``size``, in pixels, and ``quality`` of pictures: see ``LiberoEnv``.
    """

    def __init__(self, task: str, size: int, quality: str) -> None:
        self.key, self.task = (task, size, quality), find_task(task)
        self._made = dict[tuple[str, ...], Setting]()

    @cached_property
    def fairness(self) -> Fairness:
        return Fairness(self.of)

    def of(self, scene: Scene) -> Setting:
        """The setting in which a scene can begin; a SceneError if the task has no such things."""
        own = cast(self.task, scene) == self.task and not scene.confounders
        more = () if own else pool(self.task)
        if more not in self._made:
            _, size, quality = self.key
            env = LiberoEnv(self.task, size=size, quality=quality, more=more)
            if more:
                shrink(env.model)
            self._made[more] = Setting(env)
        return self._made[more]

    def close(self) -> None:
        for setting in self._made.values():
            setting.env.close()
        self._made.clear()


_idle: list[Workplace] = []


def take(task: str, size: int, quality: str) -> Workplace:
    """A workplace that nobody uses, a new one if there is none."""
    for idle in _idle:
        if idle.key == (task, size, quality):
            _idle.remove(idle)
            return idle
    return Workplace(task, size, quality)


def give_back(workplace: Workplace) -> None:
    """Leave it to the next evaluator. Its state does not matter: each scene sets everything."""
    _idle.append(workplace)
    # MuJoCo ends EGL at exit since its first picture; what is registered last comes before that
    atexit.unregister(close_idle)
    atexit.register(close_idle)
    if len(_idle) > IDLE:
        _idle.pop(0).close()


def close_idle() -> None:
    """Close what nobody uses, so that the next workplace is a new one."""
    while _idle:
        _idle.pop().close()
