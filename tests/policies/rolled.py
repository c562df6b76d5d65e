"""Outcomes of policies in scenes of the tabletop."""

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np

from tests.worlds.tabletop.sim.scenes import CATALOGUE, pick_up, put
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator


def outcomes(policy: Policy, *scenes: Scene, min_distance: float = 0.15, **conditions: Any) -> list[Outcome]:
    """Of a policy in scenes of one task."""
    asked = Conditions(task=scenes[0].task, world={"min_distance": min_distance}, **conditions)
    with closing(ManiSkillEvaluator(asked, policy, CATALOGUE)) as evaluator:
        return evaluator.evaluate(scenes)


def check_same_as_in_process(name: str, make: Callable[[], Policy], verdict: Verdict) -> None:
    """Whole rollouts of a policy behind a server have the verdict, and the actions and states of those without."""
    scenes = [pick_up(put("coke_can", -0.05, 0.1)), pick_up(put("green_cube", 0.05, -0.15, 30.0))]
    for far, near in zip(outcomes(make_policy(name), *scenes), outcomes(make(), *scenes), strict=True):
        assert verdict is far.verdict is near.verdict, far.detail
        assert np.array_equal(far.rollouts[0].actions, near.rollouts[0].actions)
        assert far.rollouts[0].states_hash == near.rollouts[0].states_hash
