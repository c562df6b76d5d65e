"""Worlds: where policies are tested. A task's name says which world it is of; nothing else needs to know."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from vlafuzz.common.plugins import PREFIX, check_trusted, is_reference, make_of, trust
from vlafuzz.errors import PrerequisiteError, UsageError, suggestion

if TYPE_CHECKING:
    from vlafuzz.worlds.base import World


@cache
def known_worlds() -> dict[str, World]:
    """The worlds that come with vlafuzz: the folders here with a module ``world``; the usual one first."""
    names = (module.name for module in pkgutil.iter_modules(__path__))
    found = (name for name in names if (Path(__file__).parent / name / "world.py").is_file())
    worlds: dict[str, World] = {one.replace("_", "-"): import_module(f"{__name__}.{one}.world").WORLD for one in found}
    return dict(sorted(worlds.items(), key=lambda item: not item[1].usual))


def world_named(name: str) -> World:
    """The world of that name: one that comes with vlafuzz, or the user's own.

    Raises:
        UsageError: there is no such world, or a file names code that the user did not. PrerequisiteError: the user's
        code raises.
    """
    if is_reference(name):
        check_trusted(name)
        return _made(name)
    if name in known_worlds():
        return known_worlds()[name]
    hint = f"{suggestion(name, known_worlds())}; your own: {PREFIX}pkg.mod:factory"
    raise UsageError(f"unknown world {name!r}", hint=hint)


_made: Callable[[str], World] = cache(make_of)


def world_of(task: str) -> World:
    """The world of a task, by its name: of our worlds as they name it, of others WORLD/TASK."""
    name, slash, _ = task.rpartition("/")
    if not is_reference(name):  # which loads none of ours
        for world in known_worlds().values():
            if world.has(task):
                return world
    return world_named(name) if slash else usual_world()


def usual_world() -> World:
    """The world that is meant where nobody names one."""
    return next(iter(known_worlds().values()))


def default_task() -> str:
    """The task of a run where nobody names one."""
    return next(iter(usual_world().tasks))


def default_policy(task: str | None = None, robot: str | None = None) -> str:
    """The policy that is tested where nobody names one; a UsageError if the task's world has none."""
    world = world_of(task) if task else usual_world()
    return world.default_policy(robot or next(iter(world.robots)))


def no_pictures(task: str) -> str:
    """Why this machine cannot draw the pictures of a task's world; empty if it can."""
    try:
        world_of(task).check_pictures()
    except PrerequisiteError as error:
        return f"{error.message}; {error.hint}"
    return ""


def task_of(world: str | None, task: str | None) -> str | None:
    """The task, suite or list that ``--world`` or ``--task`` names, None for the default; a UsageError for two."""
    if world is None:
        return task
    name, named = parted(world)
    if is_reference(name):
        trust(name)  # the user named it
    found = world_named(name)
    if task and named and task != named:
        raise UsageError(f"--world {world}, --task {task}: two tasks", hint="leave one of the two out")
    wanted = named or task
    if not wanted and found.usual:
        return None
    if not wanted and len(found.tasks) == 1:
        wanted = next(iter(found.tasks))
    own = is_reference(name)
    if wanted and (members := found.suite(wanted)):
        return ",".join(f"{name}/{one}" if own else one for one in members) if own or wanted == "all" else wanted
    if (own and wanted in found.tasks) or f"{name}/{wanted}" in found.tasks:
        return f"{name}/{wanted}"
    if not wanted or not found.has(wanted):
        problem = f"--world {name}: no task {wanted!r}" if wanted else f"--world {world}: names no task"
        raise UsageError(problem, hint=f"such as {name}:{next(iter(found.tasks))}")
    return wanted


def task_in(world: str, task: str) -> str:
    """A task's name in another world; a UsageError if that has none, or is the task's own."""
    found = task_of(world, task.rpartition("/")[2])
    if found is None or found == task:
        raise UsageError(f"--world {world}: {task} is of this world", hint="`vlafuzz list worlds` has others")
    return found


def parted(world: str) -> tuple[str, str]:
    """The name of a world, and the task behind it, empty if there is none."""
    if is_reference(world):
        parts = world.split(":")
        return ":".join(parts[:3]), ":".join(parts[3:])
    name, _, task = world.partition(":")
    return name, task


def tasks_named(names: str) -> tuple[str, ...]:
    """The tasks of a list of tasks and suites with commas, or all of the usual world; a UsageError for unknown ones."""
    if names == "all":
        return tuple(usual_world().tasks)
    parts = [name.strip() for name in names.split(",")]
    ours = [part for part in parts if not is_reference(part)]  # others load none of our worlds
    suites = {part: suite for part in ours for world in known_worlds().values() if (suite := world.suite(part))}
    tasks = tuple(dict.fromkeys(task for part in parts for task in suites.get(part, [part])))
    if len(tasks) > 1:
        for name in tasks:
            world_of(name).task(name)
    return tasks
