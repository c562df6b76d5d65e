"""Where conditions become spaces and evaluators of a world."""

from collections.abc import Mapping
from typing import Any

from vlafuzz.common.plugins import source_digest
from vlafuzz.errors import UsageError
from vlafuzz.model import Conditions, Space
from vlafuzz.model.conditions import check_choice
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.servers import client_of
from vlafuzz.rollouts.policies import experts_world, make_policy
from vlafuzz.worlds import provenance, world_of
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.recording import Recording


def make_evaluator(
    conditions: Conditions,
    policy: Policy | None = None,
    *,
    space: Space | None = None,
    checked: bool = True,
    recording: Recording | None = None,
) -> SceneEvaluator:
    """The one place where conditions become an evaluator. It loads the simulator, which takes seconds.

    By default the policy is the one that the conditions name, made anew. ``space``: of the scenes, if it is there
    already. ``checked``: whether validity is checked before a rollout.
    """
    made, world = policy or make_policy(conditions.policy, conditions.task), world_of(conditions.task)
    width, wanted = made.spec.action.width, world.action_width
    if width != wanted:
        problem = f"policy {made.spec.name!r} acts by {width} numbers, {conditions.task} takes {wanted}"
        raise UsageError(problem, hint=f"a policy of this world says so in its spec: ActionSpec(width={wanted})")
    return world.evaluator(conditions, made, space, recording=recording, checked=checked)


def here(name: str, policy: Policy, space: Space, *, workers: bool = False) -> dict[str, Any]:
    """The fields of conditions that come with what is installed (``Origin.HERE``)."""
    world = world_of(space.task.name)
    installed = {
        "spec": provenance.described(policy.spec),
        "source": source_digest(experts_world(name, space.task.name) or name, policy),
        "commit": provenance.commit(),
        "place": provenance.here(name, policy.spec, world.renderer, workers=workers),
    }
    made_of = {field: value for field, value in space.conditions.items() if field == "catalogue_digest"}
    return installed | made_of | {"simulator": world.simulator}


def with_settings(found: Mapping[str, Any], policy: str, task: str, chosen: Mapping[str, str]) -> dict[str, Any]:
    """Fields of conditions with settings of the task's world, but for defaults: those chosen, else as suit the policy.

    UsageError if the world has no such setting or value.
    """
    settings = {setting.name: setting for setting in world_of(task).settings}
    for name, value in chosen.items():
        if name not in settings:
            raise UsageError(f"{name} {value}: not for {task}", hint=f"leave {name} out")
        check_choice(name, value, settings[name].options)
    served = {name: one.served for name, one in settings.items() if one.served and client_of(policy)}
    values = {name: value for name, value in {**served, **chosen}.items() if value != settings[name].default}
    return {**found, "world": {**found.get("world", {}), **values}}
