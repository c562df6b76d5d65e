"""ManiSkillEvaluator: checks a scene, then lets the subject act in it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.errors import PrerequisiteError, SubjectError, UsageError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.outcome import Outcome, Rollout
from vlafuzz.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.sim.maniskill.env import TabletopEnv
from vlafuzz.sim.maniskill.make import make_env
from vlafuzz.sim.maniskill.objects import models_of
from vlafuzz.sim.maniskill.outlines import outlines
from vlafuzz.sim.maniskill.settle import check_dynamic
from vlafuzz.sim.maniskill.video import Recording
from vlafuzz.subjects.base import EpisodeStart, Knowing, Observation, Privileged, Subject
from vlafuzz.subjects.harness import Harness
from vlafuzz.subjects.wire import persistently
from vlafuzz.tasks.state import State
from vlafuzz.tasks.tabletop import task as task_named
from vlafuzz.validity import check_static
from vlafuzz.validity.report import Rejection

AFTER_SUCCESS = 10  # control steps, so that "at the end" means something


class ManiSkillEvaluator:
    """Runs a subject in scenes of one task.

    Args:
        min_distance: between objects' centres, metres.
        seed: of the rollouts; the n-th repeat of a scene has seed + n.
        repeats: rollouts a scene.
        stop_early: end a rollout at success instead of ten steps later.
        criteria: ``strict``, or ``published`` for the weaker success of the reference's environments.
        recording: keeps frames and observations.
        checked: whether validity is checked before a rollout.
    """

    def __init__(
        self,
        task: str,
        subject: Subject,
        catalogue: Catalogue,
        *,
        min_distance: float,
        seed: int = 0,
        repeats: int = 1,
        stop_early: bool = False,
        criteria: str = "strict",
        recording: Recording | None = None,
        checked: bool = True,
    ) -> None:
        if criteria not in ("strict", "published"):
            raise UsageError(f"criteria: {criteria!r}", hint="strict or published")
        self._task, self._subject, self._catalogue = task_named(task), subject, catalogue
        self._min_distance, self.seed, self._repeats = min_distance, seed, repeats
        self._stop_early, self._published, self._checked = stop_early, criteria == "published", checked
        self._recording = recording
        self._env: TabletopEnv | None = None
        if isinstance(subject, Knowing):
            subject.know(catalogue)

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome a scene, in order."""
        return [self._evaluate(scene) for scene in scenes]

    def renew(self) -> None:
        """The next scene gets an environment that has seen no other."""
        self._drop_env()

    def close(self) -> None:
        """Let go of simulator and subject."""
        self._drop_env()
        self._subject.close()

    def _evaluate(self, scene: Scene) -> Outcome:
        try:
            rejection = self._check(scene) if self._checked else None
            if rejection is not None:
                return Outcome.invalid(rejection.check, rejection.reason)
            rollouts = tuple(self._persist(scene, self.seed + number) for number in range(self._repeats))
        except PrerequisiteError:
            raise  # nothing that another scene would not meet too
        except SubjectError as error:
            return Outcome.error(f"subject: {error.cause}: {error}")
        except Exception as error:  # whatever a simulator throws is its crash, not the scene's failure
            self._drop_env()  # only a rebuilt environment is clean after an exception
            return Outcome.error(f"simulator: {type(error).__name__}: {error}")
        return Outcome.of(rollouts, self._task.stage_names)

    def _check(self, scene: Scene) -> Rejection | None:
        if scene.task != self._task.name:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._task.name!r}")
        rejection = check_static(scene, self._catalogue, self._min_distance)
        return rejection or check_dynamic_of(scene, self._catalogue)

    def _persist(self, scene: Scene, seed: int) -> Rollout:
        """A rollout; begun again, twice at most, when its server was lost on the way or too late."""
        return persistently(partial(self._rollout, scene, seed), ("connect", "timeout"))

    def _rollout(self, scene: Scene, seed: int) -> Rollout:
        began = time.perf_counter()
        if self._recording is not None:
            self._recording.clear()
        env = self._environment(scene.robot)
        state = env.begin(scene)
        env.applied().check(scene, env.models, env.rig)
        start = EpisodeStart(f"{scene.digest}-{seed}", scene.instruction, scene.task, seed, scene.robot)
        actions = self._act(env, Harness(self._subject, start), start, scene, state)
        monitor = env.monitor
        success = monitor.published_success if self._published else monitor.success_once
        return Rollout(
            success_once=success,
            success_at_end=monitor.success_now,
            published_success=monitor.published_success,
            reached=self._task.stage_names
            if success
            else tuple(monitor.reached[: len(self._task.stages) - 1]),
            progress=1.0
            if success
            else min(monitor.progress, 0.99),  # 1 where only the other criteria are met
            trace=monitor.trace,
            actions=np.array(actions, dtype=np.float32),
            states_hash=env.world.states_hash,
            seconds=time.perf_counter() - began,
        )

    def _act(
        self, env: TabletopEnv, harness: Harness, start: EpisodeStart, scene: Scene, state: State
    ) -> list[NDArray[np.float64]]:
        spec, monitor = self._subject.spec, env.monitor
        actions: list[NDArray[np.float64]] = []
        last = env.rig.seconds * env.control_hz
        self._record(env, scene)
        while len(actions) < last:
            observe = partial(self._observe, env, start, scene, state, len(actions))
            actions.append(harness.action(observe))
            before = monitor.success_once
            state = env.advance(actions[-1], spec.action.relative_to)
            self._record(env, scene)
            if monitor.success_once and not before:
                last = min(last, len(actions) + (0 if self._stop_early else AFTER_SUCCESS))
        return actions

    def _observe(
        self, env: TabletopEnv, start: EpisodeStart, scene: Scene, state: State, step: int
    ) -> Observation:
        spec = self._subject.spec
        observation = Observation(
            episode=start.episode,
            step=step,
            instruction=scene.instruction,
            images={camera.name: env.picture(camera.name) for camera in spec.cameras},
            state=proprioception(state, env.rig.opening) if spec.state else None,
            outlines=outlines(env.models, state, env.view, env.light) if spec.silhouettes else None,
            privileged=Privileged(scene, env.models, state, env.monitor.success_now)
            if spec.privileged
            else None,
        )
        if self._recording is not None:
            self._recording.observations.append(observation)
        return observation

    def _record(self, env: TabletopEnv, scene: Scene) -> None:
        if self._recording is not None:
            self._recording.note(env, scene.instruction)

    def _environment(self, robot: str) -> TabletopEnv:
        if self._env is not None and self._env.rig.robot != robot:
            self._drop_env()
        if self._env is None:
            watching = self._recording.camera if self._recording else None
            if watching:
                watching = replace(watching, width=rig(robot).view.width(watching.height))
            spec = self._subject.spec
            cameras = spec.cameras + ((watching,) if watching else ())
            self._env = make_env(self._task.name, self._catalogue, cameras, spec.action.hz, robot)
        return self._env

    def _drop_env(self) -> None:
        if self._env is not None:
            self._env.close()
            self._env = None


def proprioception(state: State, opening: float) -> NDArray[np.float32]:
    """``(7,)``: the hand's position (metres), rotation vector (radians), share of its ``opening``."""
    turn = Rotation.from_matrix(state.tcp_rotation).as_rotvec()
    return np.concatenate([state.tcp, turn, [state.opening / opening]]).astype(np.float32)


def check_dynamic_of(scene: Scene, catalogue: Catalogue) -> Rejection | None:
    """Settling and "not already solved", for a scene that passed the static checks."""
    models = models_of(scene.placements, catalogue)
    return check_dynamic(task_named(scene.task), models, scene.placements, rig(scene.robot).table)
