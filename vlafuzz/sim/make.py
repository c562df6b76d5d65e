"""make_evaluator: from conditions to the simulator with a policy in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.stored import stored_catalogue
from vlafuzz.objects import Catalogue
from vlafuzz.policies.base import Policy
from vlafuzz.policies.registry import make_policy

if TYPE_CHECKING:
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator
    from vlafuzz.sim.maniskill.recording import Recording


def make_evaluator(
    conditions: Conditions,
    policy: Policy | None = None,
    *,
    catalogue: Catalogue | None = None,
    checked: bool = True,
    recording: Recording | None = None,
) -> ManiSkillEvaluator:
    """The one place where conditions become an evaluator. It loads the simulator, which takes seconds.

    Args:
        policy: by default the one that the conditions name, made anew.
        catalogue: by default the built-in one with the packs of the conditions.
        checked: whether validity is checked before a rollout.
        recording: keeps frames and observations.
    """
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

    return ManiSkillEvaluator(
        conditions,
        policy or make_policy(conditions.policy),
        catalogue or stored_catalogue(conditions),
        checked=checked,
        recording=recording,
    )
