"""Evaluator: scenes in, outcomes out; and how one is made from conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.stored import stored_catalogue
from vlafuzz.objects import Catalogue
from vlafuzz.outcome import Outcome
from vlafuzz.policies.base import Policy
from vlafuzz.policies.registry import make_policy
from vlafuzz.scene import Scene
from vlafuzz.sim.stepping import Evaluation

if TYPE_CHECKING:
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator
    from vlafuzz.sim.maniskill.recording import Recording

FILM_SPEED = 3  # times real time: a failing rollout takes 16 seconds


@dataclass(frozen=True, eq=False)
class Film:
    """A recorded rollout: an MP4, and a JPEG of the scene before anything moves."""

    video: bytes
    still: bytes
    failed: bool


class Evaluator(Protocol):
    """Runs a policy in scenes. A crash in a scene is not raised, it results in an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome per scene, in order. Earlier scenes have no influence on it."""

    def close(self) -> None:
        """Release simulator and policy."""


class SteppedEvaluator(Evaluator, Protocol):
    """An evaluator whose policy may be asked by its user, together with others'."""

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        """The evaluation of a scene, step by step; no other may begin before it ends.

        ``seed``: of its first rollout; None for that of the conditions.

        Only PrerequisiteError is raised.
        """


def make_evaluator(
    conditions: Conditions,
    policy: Policy | None = None,
    *,
    catalogue: Catalogue | None = None,
    checked: bool = True,
    recording: Recording | None = None,
) -> ManiSkillEvaluator:
    """The one place where conditions become an evaluator. It loads the simulator, which takes seconds.

    By default the policy is the one that the conditions name, made anew, and the catalogue the built-in one
    with their packs. ``checked``: whether validity is checked before a rollout.
    """
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

    return ManiSkillEvaluator(
        conditions,
        policy or make_policy(conditions.policy),
        catalogue or stored_catalogue(conditions),
        checked=checked,
        recording=recording,
    )
