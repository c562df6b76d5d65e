"""Worlds: where policies are tested. A task's name says which world it is of; nothing else needs to know."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlafuzz.conditions import provenance
from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.stored import stored_catalogue, stored_operators
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.objects import Catalogue
from vlafuzz.policies.base import Policy
from vlafuzz.policies.registry import make_policy
from vlafuzz.sim.evaluator import SceneEvaluator
from vlafuzz.sim.libero.scenes.objects import load_objects
from vlafuzz.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.space.operators import ConfounderType, TargetType
from vlafuzz.tasks.tabletop import TASKS
from vlafuzz.worlds.base import World
from vlafuzz.worlds.libero import Libero
from vlafuzz.worlds.tabletop import Tabletop

if TYPE_CHECKING:
    from vlafuzz.sim.recording import Recording

TABLETOP = "tabletop"
WORLDS: dict[str, World] = {TABLETOP: Tabletop(), "libero": Libero()}


def world_of(task: str) -> World:
    """The world of a task, by its name."""
    return WORLDS["libero" if "/" in task else TABLETOP]


def default_policy(task: str = "pick-up", robot: str | None = None) -> str:
    """What is tested where nobody names a policy; a UsageError if the task's world has none."""
    world = world_of(task)
    return world.default_policy(robot or next(iter(world.robots)))


def task_of(world: str | None, task: str | None) -> str | None:
    """The task that ``--world`` or ``--task`` names; None for the default.

    Raises:
        UsageError: there is no such world, it needs a task, or there are two of them.
    """
    if world is None:
        return task
    named = _task_in(world)
    if task and named and task != named:
        raise UsageError(f"--world {world}, --task {task}: two tasks", hint="leave one of the two out")
    return named or task


def tasks_named(names: str) -> tuple[str, ...]:
    """The tasks of a list with commas, or all of the tabletop.

    Raises:
        UsageError: there is no such task.
    """
    if names == "all":
        return tuple(TASKS)
    tasks = tuple(dict.fromkeys(name.strip() for name in names.split(",")))
    if len(tasks) > 1:
        for name in tasks:
            world_of(name).task(name)
    return tasks


def _task_in(world: str) -> str | None:
    name, _, task = world.partition(":")
    if name not in WORLDS:
        raise UsageError(f"unknown world {name!r}", hint=suggestion(name, WORLDS))
    if name == TABLETOP:
        return task or None
    if "/" not in task:
        problem = f"--world {world}: names no task"
        raise UsageError(problem, hint=f"such as {name}:libero_object/0")
    return task


def make_evaluator(
    conditions: Conditions,
    policy: Policy | None = None,
    *,
    catalogue: Catalogue | None = None,
    checked: bool = True,
    recording: Recording | None = None,
) -> SceneEvaluator:
    """The one place where conditions become an evaluator. It loads the simulator, which takes seconds.

    By default the policy is the one that the conditions name, made anew, and the catalogue the built-in one
    with their packs. ``checked``: whether validity is checked before a rollout.
    """
    return world_of(conditions.task).evaluator(
        conditions,
        policy or make_policy(conditions.policy),
        catalogue or stored_catalogue(conditions),
        recording=recording,
        checked=checked,
    )


def stored_space(source: Path, conditions: Conditions) -> SearchSpace:
    """The space that contains the scenes of a run; ``source`` is the store or corpus, for messages.

    Raises:
        StoreError: another version wrote it, with other operators.
        UsageError: an object pack is gone.
        PrerequisiteError: its world's packages are not installed.
    """
    operators = stored_operators(source, conditions)
    world = world_of(conditions.task)
    return world.space(operators, stored_catalogue(conditions), conditions.task, conditions.robot)


def make_space(operators: OperatorSet, catalogue: Catalogue, task: str, robot: str) -> SearchSpace:
    """The scenes of a task that the operators can make.

    Raises:
        UsageError: an operator is to vary that has nothing to vary in this world.
    """
    space = world_of(task).space(operators, catalogue, task, robot)
    offered = {gene.operator for gene in space.by_path.values()}
    idle = space.operators.varied - offered
    if idle and space.genes:  # some of a world's tasks lack what varies there by default
        idle -= load_operators(space.rig.operators).varied
    for name in sorted(idle):
        raise UsageError(f"{name}: nothing of {task} varies so", hint=f"known: {', '.join(sorted(offered))}")
    return space


def check_names(operators: OperatorSet, catalogue: Catalogue) -> None:
    """Raise a UsageError where operators name an object that no world has."""
    known = {*catalogue, *load_objects().words}
    for part in (operators, *operators.tasks.values()):
        targets, around = part.get(TargetType), part.get(ConfounderType)
        for operator, names in ((targets, targets.names), (targets, targets.onto), (around, around.names)):
            for name in names or ():
                if name not in known:
                    raise UsageError(f"{operator.name}: no object {name!r}", hint=suggestion(name, known))


def here(
    task: str, name: str, policy: Policy, catalogue: Catalogue, *, workers: bool = False
) -> dict[str, Any]:
    """The fields of conditions that come with what is installed; see ``provenance.here``."""
    world = world_of(task)
    installed = provenance.here(name, policy, catalogue, world.renderer, workers=workers)
    return installed | {"simulator": world.simulator}
