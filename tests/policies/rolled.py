"""Outcomes of policies in scenes of the tabletop."""

from contextlib import closing
from typing import Any

from tests.worlds.tabletop.sim.scenes import CATALOGUE
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator


def outcomes(policy: Policy, *scenes: Scene, min_distance: float = 0.15, **conditions: Any) -> list[Outcome]:
    """Of a policy in scenes of one task."""
    asked = Conditions(task=scenes[0].task, world={"min_distance": min_distance}, **conditions)
    with closing(ManiSkillEvaluator(asked, policy, CATALOGUE)) as evaluator:
        return evaluator.evaluate(scenes)
