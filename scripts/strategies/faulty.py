"""Worlds in the simulator: a policy that also has planted faults, of the same kinds as without physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np

from strategies.faults import Density, World, space_of, world
from vlafuzz.model import Conditions, Outcome, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, Policy
from vlafuzz.rollouts.executor import evaluate_safely
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.evaluator import Evaluator
from vlafuzz.worlds.tabletop.space import load_operators
from vlafuzz.worlds.tabletop.tasks import LIFTED, State

STEADY = 2  # control steps that a lifted object is held before it is let go: the stage counts as reached
OPEN, CLOSED = 1.0, -1.0  # commands of the built-in policies to the gripper
LIFT = 1  # the second of three stages


@dataclass(frozen=True)
class SimulatedWorld(World):
    """A world whose rollouts are the simulator's. ``policy``: that the faults are planted in."""

    policy: str = "expert"

    def evaluate(self, scene: Scene, number: int = 0) -> Outcome:
        """One rollout, whatever its number: policies and simulator are deterministic."""
        evaluator, policy = _evaluator(self.policy, self.task)
        policy.world = self
        return evaluate_safely(evaluator, scene)

    def fails_anyway(self, scene: Scene) -> bool:
        """Whether the policy fails in a scene without any planted fault."""
        return replace(self, faults=()).evaluate(scene).verdict is Verdict.FAILED


def simulated(density: Density, seed: int, policy: str) -> SimulatedWorld:
    """The world without physics of that seed, with another policy."""
    planted = world(density, seed, rate=1.0)
    return SimulatedWorld(**{field.name: getattr(planted, field.name) for field in fields(World)}, policy=policy)


@cache
def _evaluator(policy: str, task: str) -> tuple[Evaluator, Faulty]:
    """One for all worlds of a policy."""
    operators, faulty = load_operators(), Faulty(make_policy(policy))
    conditions = Conditions(task=task, world=operators.conditions["world"], stop_early=True)
    return make_evaluator(conditions, faulty, space=space_of(task)), faulty


class Faulty:
    """Loses the earliest stage of the planted faults whose conditions a scene meets.

    It does not move, or stays where it has grasped, or lets go of what it has lifted.
    """

    world: World  # with the faults

    def __init__(self, policy: Policy) -> None:
        self.spec, self._policy = replace(policy.spec, privileged=True), policy
        self._rollouts: dict[str, _Rollout] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._rollouts.clear()
        self._policy.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [self._act(seen) for seen in observations]

    def close(self) -> None:
        self._policy.close()

    def _act(self, seen: Observation) -> ActionChunk:
        known = seen.privileged
        assert known is not None
        if seen.episode not in self._rollouts:
            stages = (self.world.faults[fault].stage for fault in self.world.met(known.scene))
            height = float(known.state.positions[0, 2])
            self._rollouts[seen.episode] = _Rollout(min(stages, default=None), height)
        gripper = self._rollouts[seen.episode].stopped(known.state)
        if gripper is None:
            return self._policy.act([seen])[0]
        return ActionChunk(np.array([[0.0] * 6 + [gripper]]))


@dataclass
class _Rollout:
    """A rollout of a faulty policy. ``lost``: the stage, if any; ``height``: of the target at the start."""

    lost: int | None
    height: float
    lifted: int = 0
    over: bool = False

    def stopped(self, state: State) -> float | None:
        """The gripper's command once the policy moves no more; None while it does."""
        held = state.held == 0
        raised = held and state.positions[0, 2] - self.height >= LIFTED
        self.lifted = self.lifted + 1 if raised else 0
        if self.lost is not None and not self.over:
            self.over = (True, held, self.lifted > STEADY)[self.lost]
        if not self.over:
            return None
        return CLOSED if self.lost == LIFT else OPEN
