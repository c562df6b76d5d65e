"""ManiSkillEvaluator checks that scenes are fair and runs a policy in them; an Episode is one rollout."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.clients import wire
from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.stored import stored_visible
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.outcome import Outcome, Rollout
from vlafuzz.policies.base import (
    Calibration,
    EpisodeStart,
    Knowing,
    Observation,
    Policy,
    PolicySpec,
    Privileged,
)
from vlafuzz.policies.harness import Harness, release
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.sim.maniskill.env import TabletopEnv, make_env
from vlafuzz.sim.maniskill.objects import models_of
from vlafuzz.sim.maniskill.outlines import outlines
from vlafuzz.sim.maniskill.recording import Recording
from vlafuzz.sim.maniskill.settle import Settled, settle, start_poses
from vlafuzz.sim.stepping import Asking, Evaluation, drive
from vlafuzz.tasks.base import State
from vlafuzz.tasks.tabletop import task as task_named
from vlafuzz.validity import Rejection, check_static

AFTER_SUCCESS = 10  # control steps, to tell success at the end from success once


class Episode:
    """Begins a rollout of a scene in an environment. ``actions``: so far, ``(7,)``, metric.

    The conditions define when a rollout is over and what counts as success.
    """

    def __init__(
        self, env: TabletopEnv, spec: PolicySpec, scene: Scene, seed: int, conditions: Conditions
    ) -> None:
        self.env, self._spec, self._scene = env, spec, scene
        self._after = 0 if conditions.stop_early else AFTER_SUCCESS
        self._published = conditions.criteria == "published"
        self._state = env.begin(scene, seed)
        env.applied().check(scene, env.poses, env.rig)
        self.start = EpisodeStart(f"{scene.digest}-{seed}", scene.instruction, scene.task, seed, scene.robot)
        self.actions: list[NDArray[np.float64]] = []
        self._last = env.rig.seconds * env.control_hz

    @property
    def over(self) -> bool:
        return len(self.actions) >= self._last

    @property
    def success(self) -> bool:
        """Whether the task has been solved at any time."""
        monitor = self.env.monitor
        return monitor.published_success if self._published else monitor.success_once

    @property
    def success_now(self) -> bool:
        """Whether the task is solved after the last step."""
        monitor = self.env.monitor
        return monitor.published_now if self._published else monitor.success_now

    @property
    def instruction(self) -> str:
        """The current instruction, see ``Scene.instruction_at``."""
        return self._scene.instruction_at(len(self.env.monitor.reached))

    def observe(self) -> Observation:
        """The present observation, with the parts that the spec asks for."""
        env, spec, scene, state = self.env, self._spec, self._scene, self._state
        return Observation(
            episode=self.start.episode,
            step=len(self.actions),
            instruction=self.instruction,
            images={camera.name: env.seen(camera.name) for camera in spec.cameras},
            state=proprioception(state, env.rig.opening) if spec.state else None,
            outlines=outlines(env.models, state, env.view, env.light, env.table_colour)
            if spec.silhouettes
            else None,
            privileged=Privileged(scene, env.models, state, self.success_now) if spec.privileged else None,
            calibration=Calibration(env.view, env.light, env.models[: env.task.targets])
            if spec.calibrated
            else None,
        )

    def advance(self, action: NDArray[np.float64]) -> None:
        """Execute a metric action for one control step."""
        before = self.success
        self.actions.append(action)
        self._state = self.env.advance(action, self._spec.action.relative_to)
        if self.success and not before:
            self._last = min(self._last, len(self.actions) + self._after)

    def rollout(self, seconds: float = 0.0) -> Rollout:
        """The result of a rollout that took so many seconds."""
        monitor, names = self.env.monitor, self.env.task.stage_names
        return Rollout(
            success_once=self.success,
            success_at_end=self.success_now,
            published_success=monitor.published_success,
            reached=names if self.success else tuple(monitor.reached[: len(names) - 1]),
            # 1 if only the other criteria are met
            progress=1.0 if self.success else min(monitor.progress, 0.99),
            trace=monitor.trace,
            actions=np.array(self.actions, dtype=np.float32),
            states_hash=self.env.world.states_hash,
            seconds=seconds,
        )


def proprioception(state: State, opening: float) -> NDArray[np.float32]:
    """``(7,)``: the hand's position (metres), rotation vector (radians), share of its ``opening``."""
    turn = Rotation.from_matrix(state.tcp_rotation).as_rotvec()
    return np.concatenate([state.tcp, turn, [state.opening / opening]]).astype(np.float32)


class ManiSkillEvaluator:
    """Runs a policy in scenes of one task.

    Args:
        conditions: all that determines an outcome beside the scene; their ``policy`` is only a name.
        recording: keeps frames and observations.
        checked: whether validity is checked before a rollout.

    Attributes:
        seed: of the next rollouts; initially that of the conditions.
    """

    def __init__(
        self,
        conditions: Conditions,
        policy: Policy,
        catalogue: Catalogue,
        *,
        recording: Recording | None = None,
        checked: bool = True,
    ) -> None:
        self._conditions, self._task = conditions, task_named(conditions.task)
        self._policy, self._catalogue, self.seed = policy, catalogue, conditions.seed
        self._checked, self._recording = checked, recording
        self._visible = stored_visible(conditions)
        self._env: TabletopEnv | None = None
        if isinstance(policy, Knowing):
            policy.know(catalogue)

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        return [drive(self.evaluation(scene), self._policy) for scene in scenes]

    def check(self, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is."""
        if scene.task != self._task.name:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._task.name!r}")
        distance, spec = self._conditions.min_distance, self._policy.spec
        flat = spec.silhouettes and not spec.cameras and not spec.calibrated
        rejection = check_static(scene, self._catalogue, distance, self._visible, outlines=flat)
        return rejection or settled(scene, self._catalogue, self._conditions.placement).rejection

    def begin(self, scene: Scene, seed: int) -> Episode:
        """A rollout in a fair scene, for callers that step through it themselves."""
        env, spec = self._environment(scene.robot), self._policy.spec
        return Episode(env, spec, scene, seed, self._conditions)

    def renew(self) -> None:
        """Use a new environment for the next scene."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def close(self) -> None:
        self.renew()
        release(self._policy)

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        """See ``SteppedEvaluator``."""
        try:
            rejection = self.check(scene) if self._checked else None
            if rejection is not None:
                return Outcome.invalid(rejection.check, rejection.reason)
            rollouts: tuple[Rollout, ...] = ()
            first = self.seed if seed is None else seed
            for number in range(first, first + self._conditions.repeats):
                rollouts += ((yield from self._repeated(scene, number)),)
        except PrerequisiteError:
            raise  # other scenes would raise it too
        except PolicyError as error:
            return Outcome.error(f"policy: {error.cause}: {error}", unanswered=error.cause in wire.UNANSWERED)
        except Exception as error:  # a crash of the simulator is not a failure of the policy
            self.renew()  # after an exception only a new environment is clean
            return Outcome.error(f"simulator: {type(error).__name__}: {error}")
        return Outcome.of(rollouts, self._task.stage_names)

    def _repeated(self, scene: Scene, seed: int) -> Asking[Rollout]:
        """A rollout, begun again at most twice if the policy's server was lost or too late."""
        for pause in wire.PAUSES:
            try:
                return (yield from self._rollout(scene, seed))
            except PolicyError as error:
                wire.check_repeatable(error, pause, wire.UNANSWERED)
            yield pause
        return (yield from self._rollout(scene, seed))

    def _rollout(self, scene: Scene, seed: int) -> Asking[Rollout]:
        began = time.perf_counter()
        if self._recording is not None:
            self._recording.clear()
        episode = self.begin(scene, seed)
        harness = Harness(self._policy, episode.start)
        self._record(episode)
        while not episode.over:
            if harness.empty:
                chunk = yield self._observe(episode)
                assert chunk is not None
                harness.accept(chunk)
            episode.advance(harness.next_action())
            self._record(episode)
        return episode.rollout(time.perf_counter() - began)

    def _observe(self, episode: Episode) -> Observation:
        observation = episode.observe()
        if self._recording is not None:
            self._recording.observations.append(observation)
        return observation

    def _record(self, episode: Episode) -> None:
        if self._recording is not None:
            self._recording.note(episode.env, episode.instruction)

    def _environment(self, robot: str) -> TabletopEnv:
        if self._env is not None and self._env.rig.robot != robot:
            self.renew()
        if self._env is None:
            spec = self._policy.spec
            cameras = spec.cameras
            if self._recording and (extra := self._recording.camera):
                cameras += (replace(extra, width=rig(robot).view.width(extra.height)),)
            self._env = make_env(
                self._task.name, self._catalogue, cameras, spec.action.hz, robot, self._conditions.placement
            )
        return self._env


def settled(scene: Scene, catalogue: Catalogue, placement: str = "resting") -> Settled:
    """Settle a scene whose objects are in the catalogue."""
    models, setup = models_of(scene.placements, catalogue), rig(scene.robot)
    poses = start_poses(scene, models, setup, dropped=True) if placement == "published" else None
    return settle(task_named(scene.task), models, scene.placements, setup.table, poses)
