"""LIBERO's tasks as tasks: stages by the simulator's state, which each of them judges itself."""

from __future__ import annotations

from functools import cache

from vlafuzz.model.task import Task
from vlafuzz.worlds.libero.stages import find_stages
from vlafuzz.worlds.libero.suites import find_task


@cache
def task(name: str) -> Task:
    """The task that ``SUITE/NUMBER`` names. Its situations are a ``stages.Moment`` each.

    Raises:
        UsageError: there is no such suite or task.
        PrerequisiteError: LIBERO is not installed.
    """
    found = find_task(name)
    stages = find_stages(found)
    return Task(name, len(found.things), stages, stages[-1].holds)
