"""``vlafuzz lint WORLD:SUITE``: the verdicts on suites of other worlds."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.errors import sentence
from vlafuzz.worlds import known_worlds
from vlafuzz.worlds.audit import CHECKS, AuditedSuite, AuditedTask, Scope
from vlafuzz.worlds.capabilities import Audited


def is_suite(name: Path) -> bool:
    """Whether it is the name of a suite, WORLD:SUITE, and not that of a file."""
    return ":" in str(name) and _audited(str(name)) is not None and not name.exists()


def _audited(suite: str) -> Audited | None:
    """The world of ``WORLD:SUITE``, if it can audit its own initial states."""
    world = known_worlds().get(suite.partition(":")[0])
    return world if isinstance(world, Audited) else None


def lint_suites(names: Sequence[str], states: int | None, pictures: Path | None, *, json: bool, verbose: bool) -> None:
    """Print the verdicts on suites; the exit code is 1 when an initial state has a defect.

    Args:
        states: the first ones of each task; None for all.
        pictures: a folder for them.
    """
    with Bar() as bar:
        scope = Scope(states=states, pictures=pictures, watch=bar)
        worlds = [(name, _audited(name)) for name in names]
        suites = [world.audit(name.partition(":")[2], scope) for name, world in worlds if world]
    if json:
        print_json([_document(suite) for suite in suites])
    else:
        for suite in suites:
            _print(suite, verbose=verbose)
    if pictures:
        stderr().print(f"pictures in {pictures}: both cameras at the start, after settling, after two seconds")
    if any(task.defects for suite in suites for task in suite.tasks):
        raise typer.Exit(1)


def _print(suite: AuditedSuite, *, verbose: bool) -> None:
    for task in suite.tasks if verbose else ():
        for defect in task.defects:
            line = sentence(f"{task.name} state {defect.state}: {defect.check}: {defect.reason}")
            data().write(f"{line}\n")
    shown = [check for check in CHECKS if any(task.count(check) for task in suite.tasks)]
    rows = [
        {"task": task.name, "states": task.states, "sound": task.sound} | _counts(task, shown) for task in suite.tasks
    ]
    print_rows(rows, title=f"{suite.suite}: initial states and their defects")
    worst = [
        {"task": task.name, "defect": one.check, "states": count, "worst": one.state, "what": one.reason}
        for task in suite.tasks
        for one, count in task.kinds()
    ]
    if worst:
        print_rows(worst, title="the worst of each kind")
    for check in shown:
        stderr().print(f"{check}: {CHECKS[check]}")
    stderr().print(f"with {suite.surroundings}; other versions have other physics")


def _document(suite: AuditedSuite) -> dict[str, Any]:
    tasks = [
        {"task": task.name, "instruction": task.instruction, "states": task.states, "sound": task.sound}
        | _counts(task, list(CHECKS))
        | {"defects": [asdict(defect) for defect in task.defects]}
        for task in suite.tasks
    ]
    return {"suite": suite.suite, "with": suite.surroundings, "tasks": tasks}


def _counts(task: AuditedTask, checks: Sequence[str]) -> dict[str, int]:
    return {check: task.count(check) for check in checks}
