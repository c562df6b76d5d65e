"""Casts: which things a scene of a task has, instead of and beside those of the suite. No simulator."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.libero.scenes.objects import kind_of, load_objects, mistakable, replaced
from vlafuzz.worlds.libero.suites import LiberoTask


@cache
def swaps(task: LiberoTask) -> tuple[tuple[str, ...], ...]:
    """For each thing of a task what may stand in its place, itself first.

    Nothing else may where the thing is not carried, has no class, or the instruction does not say it once.
    """
    objects, present = load_objects(), set(map(kind_of, task.things))
    return tuple(
        (thing, *(name for name in objects.alike(kind_of(thing)) if name not in present))
        if thing in task.carried and objects.said(kind_of(thing), task.instruction)
        else (thing,)
        for thing in task.things
    )


@cache
def extras(task: LiberoTask) -> tuple[str, ...]:
    """The objects that may be added to a task: no double of what it has, or of what it says."""
    present = set(map(kind_of, task.things))
    added = (name for name in load_objects().added if name not in present)
    return tuple(name for name in added if not mistakable(name, task.instruction))


@cache
def pool(task: LiberoTask) -> tuple[str, ...]:
    """All objects that scenes of a task may have beside its own."""
    return tuple(dict.fromkeys([*(name for names in swaps(task) for name in names[1:]), *extras(task)]))


@cache
def recast(task: LiberoTask, things: tuple[str, ...]) -> LiberoTask:
    """The task with other things in the place of its own: goal, start and instruction are about them.

    Raises:
        SceneError: one of them may not stand there.
    """
    names = dict(zip(task.things, things, strict=False))
    instruction, objects = task.instruction, load_objects()
    for own, options in zip(task.things, swaps(task), strict=True):
        name = names.get(own)
        if name not in options or len(things) != len(task.things):
            expected = ", ".join(" or ".join(options) for options in swaps(task))
            problem = f"targets: {', '.join(things)} are not the things of {task}"
            raise SceneError(problem, hint=f"expected {expected}")
        if name != own:
            said = objects.said(kind_of(own), task.instruction)
            instruction = replaced(str(said), objects.words[name][0], instruction)
    if len(set(things)) < len(things):
        raise SceneError(f"targets: {', '.join(things)}: one thing is there twice")
    initial, goal = (
        tuple(tuple(names.get(word, word) for word in atom) for atom in atoms) for atoms in (task.initial, task.goal)
    )
    interest = tuple(names.get(name, name) for name in task.interest)
    return replace(task, instruction=instruction, initial=initial, goal=goal, interest=interest, things=things)


def cast(task: LiberoTask, scene: Scene) -> LiberoTask:
    """The task as a scene has it, after a check of what is added.

    Raises:
        SceneError: the task has no such thing, or one could be taken for what the task is about.
    """
    own = recast(task, tuple(placed.object for placed in scene.targets))
    added = [placed.object for placed in scene.confounders]
    for name in added:
        if name not in extras(task):
            known = ", ".join(extras(task))
            raise SceneError(f"confounders: {name!r} cannot be added to {task}", hint=f"known: {known}")
        if doubles(own, name) or added.count(name) > 1:
            raise SceneError(f"confounders: {name} is there twice, or could be taken for a target")
    return own


def doubles(task: LiberoTask, name: str) -> bool:
    """Whether an object is there already, or could be taken for what the instruction says."""
    return name in task.things or mistakable(name, task.instruction)
