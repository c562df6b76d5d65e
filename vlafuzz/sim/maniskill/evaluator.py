"""ManiSkillEvaluator: checks that scenes are fair and runs a policy in them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from vlafuzz.clients.wire import UNANSWERED, with_retries
from vlafuzz.conditions.conditions import Conditions
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.outcome import Outcome, Rollout
from vlafuzz.policies.base import Knowing, Observation, Policy
from vlafuzz.policies.harness import Harness
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.sim.maniskill.drop import start_poses
from vlafuzz.sim.maniskill.env import TabletopEnv, make_env
from vlafuzz.sim.maniskill.episode import Episode
from vlafuzz.sim.maniskill.objects import models_of
from vlafuzz.sim.maniskill.recording import Recording
from vlafuzz.sim.maniskill.settle import Settled, settle
from vlafuzz.tasks.tabletop import task as task_named
from vlafuzz.validity import Rejection, check_static


class ManiSkillEvaluator:
    """Runs a policy in scenes of one task.

    Args:
        conditions: task, seed and all else that determines an outcome; their ``policy`` is only a name.
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
        self._env: TabletopEnv | None = None
        if isinstance(policy, Knowing):
            policy.know(catalogue)

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome per scene, in order."""
        return [self._evaluate(scene) for scene in scenes]

    def check(self, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is."""
        if scene.task != self._task.name:
            return Rejection("semantic", f"its task is {scene.task!r}, not {self._task.name!r}")
        rejection = check_static(scene, self._catalogue, self._conditions.min_distance)
        return rejection or settled(scene, self._catalogue, self._conditions.placement).rejection

    def begin(self, scene: Scene, seed: int) -> Episode:
        """A rollout in a fair scene, for callers that step through it themselves."""
        env, spec = self._environment(scene.robot), self._policy.spec
        return Episode(env, spec, scene, seed, self._conditions)

    def renew(self) -> None:
        """Use a new environment for the next scene."""
        self._drop_env()

    def close(self) -> None:
        """Close simulator and policy."""
        self._drop_env()
        self._policy.close()

    def _evaluate(self, scene: Scene) -> Outcome:
        try:
            rejection = self.check(scene) if self._checked else None
            if rejection is not None:
                return Outcome.invalid(rejection.check, rejection.reason)
            seeds = range(self.seed, self.seed + self._conditions.repeats)
            rollouts = tuple(self._persist(scene, seed) for seed in seeds)
        except PrerequisiteError:
            raise  # other scenes would raise it too
        except PolicyError as error:
            return Outcome.error(f"policy: {error.cause}: {error}", unanswered=error.cause in UNANSWERED)
        except Exception as error:  # a crash of the simulator is not a failure of the policy
            self._drop_env()  # after an exception only a new environment is clean
            return Outcome.error(f"simulator: {type(error).__name__}: {error}")
        return Outcome.of(rollouts, self._task.stage_names)

    def _persist(self, scene: Scene, seed: int) -> Rollout:
        """A rollout, restarted at most twice if the policy's server was lost or too late."""
        return with_retries(partial(self._rollout, scene, seed), UNANSWERED)

    def _rollout(self, scene: Scene, seed: int) -> Rollout:
        began = time.perf_counter()
        if self._recording is not None:
            self._recording.clear()
        episode = self.begin(scene, seed)
        harness = Harness(self._policy, episode.start)
        self._record(episode)
        while not episode.over:
            episode.advance(harness.action(partial(self._observe, episode)))
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
            self._drop_env()
        if self._env is None:
            spec = self._policy.spec
            cameras = spec.cameras
            if self._recording and (extra := self._recording.camera):
                cameras += (replace(extra, width=rig(robot).view.width(extra.height)),)
            self._env = make_env(
                self._task.name, self._catalogue, cameras, spec.action.hz, robot, self._conditions.placement
            )
        return self._env

    def _drop_env(self) -> None:
        if self._env is not None:
            self._env.close()
            self._env = None


def settled(scene: Scene, catalogue: Catalogue, placement: str = "resting") -> Settled:
    """Settle a scene whose objects are in the catalogue."""
    models, setup = models_of(scene.placements, catalogue), rig(scene.robot)
    poses = start_poses(scene, models, setup, dropped=True) if placement == "published" else None
    return settle(task_named(scene.task), models, scene.placements, setup.table, poses)
