"""Episode: one rollout step by step, with the policy's observations and the rollout's result."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.outcome import Rollout
from vlafuzz.policies.base import EpisodeStart, Observation, Outlines, PolicySpec, Privileged
from vlafuzz.scene import Scene
from vlafuzz.sim.maniskill.env import TabletopEnv
from vlafuzz.sim.maniskill.outlines import outlines
from vlafuzz.tasks.base import State

AFTER_SUCCESS = 10  # control steps, to tell success at the end from success once


class Episode:
    """Begins a rollout of a scene in an environment.

    Args:
        spec: of the policy.
        conditions: define when a rollout is over and what counts as success.

    Attributes:
        actions: so far, ``(7,)`` metric actions.
    """

    def __init__(
        self,
        env: TabletopEnv,
        spec: PolicySpec,
        scene: Scene,
        seed: int,
        conditions: Conditions,
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
        """Whether the rollout has ended."""
        return len(self.actions) >= self._last

    @property
    def success(self) -> bool:
        """Whether the task has been solved at any time."""
        monitor = self.env.monitor
        return monitor.published_success if self._published else monitor.success_once

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
            outlines=self._outlines() if spec.silhouettes else None,
            privileged=Privileged(scene, env.models, state, env.monitor.success_now)
            if spec.privileged
            else None,
        )

    def _outlines(self) -> Outlines:
        env = self.env
        return outlines(env.models, self._state, env.view, env.light, env.table_colour)

    def advance(self, action: NDArray[np.float64]) -> None:
        """Execute a metric action for one control step."""
        monitor = self.env.monitor
        before = monitor.success_once
        self.actions.append(action)
        self._state = self.env.advance(action, self._spec.action.relative_to)
        if monitor.success_once and not before:
            self._last = min(self._last, len(self.actions) + self._after)

    def rollout(self, seconds: float = 0.0) -> Rollout:
        """The result of a rollout that took so many seconds."""
        monitor, names = self.env.monitor, self.env.task.stage_names
        return Rollout(
            success_once=self.success,
            success_at_end=monitor.success_now,
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
