"""``vlafuzz lint WORLD:SUITE``: the verdicts on suites of other worlds."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.errors import UsageError, sentence
from vlafuzz.worlds import known_worlds
from vlafuzz.worlds.audit import CHECKS, AuditedSuite, AuditedTask, Scope
from vlafuzz.worlds.capabilities import Audited


def named_suites(names: list[Path], of_files: Mapping[str, object]) -> list[str]:
    """The suites of other worlds among the names that are to be linted; empty if they are files.

    ``of_files``: values of the flags that only files have.

    Raises:
        UsageError: there are both, or a suite with such a flag.
    """
    suites = [str(name) for name in names if ":" in str(name) and _audited(str(name)) and not name.exists()]
    if suites and len(suites) < len(names):
        raise UsageError(f"files and suites at once: {suites[0]}", hint="lint them one after the other")
    if suites:
        refuse(of_files, "a suite's initial states are checked as they are")
    return suites


def _audited(suite: str) -> Audited | None:
    """The world of ``WORLD:SUITE``, if it can audit its own initial states."""
    world = known_worlds().get(suite.partition(":")[0])
    return world if isinstance(world, Audited) else None


def refuse(flags: Mapping[str, object], reason: str) -> None:
    """Raise UsageError if one of the flags was given."""
    for flag, value in flags.items():
        if value is not None:
            raise UsageError(f"{flag}: {reason}", hint="leave it out")


def lint_suites(names: list[str], scope: Scope, *, json: bool, verbose: bool) -> None:
    """Print the verdicts on suites; the exit code is 1 when an initial state has a defect."""
    with Bar() as bar:
        watched = Scope(states=scope.states, pictures=scope.pictures, watch=bar)
        worlds = [(name, _audited(name)) for name in names]
        suites = [world.audit(name.partition(":")[2], watched) for name, world in worlds if world]
    if json:
        print_json([_suite(suite) for suite in suites])
    else:
        for suite in suites:
            _print(suite, verbose=verbose)
    if scope.pictures:
        stderr().print(
            f"pictures in {scope.pictures}: both cameras at the start, after settling, after two seconds"
        )
    if any(task.defects for suite in suites for task in suite.tasks):
        raise typer.Exit(1)


def _print(suite: AuditedSuite, *, verbose: bool) -> None:
    if verbose:
        for task in suite.tasks:
            for defect in task.defects:
                data().write(
                    f"{sentence(f'{task.name} state {defect.state}: {defect.check}: {defect.reason}')}\n"
                )
    shown = [check for check in CHECKS if any(task.count(check) for task in suite.tasks)]
    rows = [
        {"task": task.name, "states": task.states, "sound": task.sound}
        | {check: task.count(check) for check in shown}
        for task in suite.tasks
    ]
    print_rows(rows, title=f"{suite.suite}: initial states and their defects")
    worst = [row for task in suite.tasks for row in _worst(task)]
    if worst:
        print_rows(worst, title="the worst of each kind")
    for check in shown:
        stderr().print(f"{check}: {CHECKS[check]}")
    stderr().print(f"with {suite.surroundings}; other versions have other physics")


def _worst(task: AuditedTask) -> list[dict[str, Any]]:
    return [
        {
            "task": task.name,
            "defect": defect.check,
            "states": count,
            "worst": defect.state,
            "what": defect.reason,
        }
        for defect, count in task.kinds()
    ]


def _suite(suite: AuditedSuite) -> dict[str, Any]:
    tasks = [
        {"task": task.name, "instruction": task.instruction, "states": task.states, "sound": task.sound}
        | {check: task.count(check) for check in CHECKS}
        | {"defects": [asdict(defect) for defect in task.defects]}
        for task in suite.tasks
    ]
    return {"suite": suite.suite, "with": suite.surroundings, "tasks": tasks}
