"""``vlafuzz lint``: verdicts on files of scenes, and on suites of other worlds."""

import os
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, opened, option, refuse
from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.errors import UsageError, check_number, sentence
from vlafuzz.model.scene_lines import is_document
from vlafuzz.worlds import known_worlds, world_with
from vlafuzz.worlds.capabilities import CHECKS, Audited, AuditedSuite, FileVerdicts, Frame, SceneFormats

FRAME_HELP = "How VLATest's files are read: see `vlafuzz export --help`."


def check_frame(frame: Frame | None, files: list[Path]) -> None:
    """Raise a UsageError if a frame is given and no file is one of VLATest."""
    if frame and not any(map(is_document, files)):
        raise UsageError(f"--frame {frame}: none of the files is one of VLATest", hint="leave it out")


def lint(
    files: Annotated[
        list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's; or a suite, WORLD:SUITE.")
    ],
    static: Annotated[
        bool | None,
        option(
            "Only what needs no simulator: semantics, geometry and visibility; or all.",
            "all; for VLATest's files --static",
            flag="--static/--settle",
        ),
    ] = None,
    frame: Annotated[Frame | None, option(FRAME_HELP, "fit")] = None,
    pack: PackFlag = None,
    states: Annotated[int | None, option("Of a suite: the first initial states of each task.", "all")] = None,
    verbose: Annotated[bool, option("Say what is wrong in each line.", flag="--verbose -v")] = False,
    json: JsonFlag = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, unseen (a target that cannot be seen in the policy's first picture), settling (a second
    of physics), not already solved. The exit code is 1 when a scene fails a check or a line is broken.

    Of suites of another world, the initial states are checked: what overlaps, slides, falls or still moves when a
    policy would begin, what is solved already, and what problem or instruction say and is not true.
    """
    check_number("--states", states, 1)
    suites = [str(name) for name in files if _world_of(str(name)) and not name.exists()]
    if suites and len(suites) < len(files):
        raise UsageError(f"files and suites at once: {suites[0]}", hint="lint them one after the other")
    if suites:
        of_files = {"--static": static, "--frame": frame, "--pack": pack}
        refuse(of_files, "a suite's initial states are checked as they are")
        _lint_suites(suites, states, json=json, verbose=verbose)
        return
    refuse({"--states": states}, "only suites have initial states")
    check_frame(frame, files)
    world, packs, judged = world_with(SceneFormats), opened(pack), list[FileVerdicts]()
    with Bar() as bar:
        for path in files:
            quick = is_document(path) if static is None else static
            judged.append(world.lint(path, frame or "fit", packs, bar, settle=not quick))
    problems = [(file.path, problem) for file in judged for problem in file.problems]
    if json:
        problems_of = ([asdict(problem) for problem in file.problems] for file in judged)
        files_told = zip(judged, problems_of, strict=True)
        print_json([{"file": str(file.path), **file.counts, "rejections": found} for file, found in files_told])
    else:
        for path, problem in problems if verbose else ():
            line = sentence(f"{path}:{problem.line}: {problem.check}: {problem.reason}")
            data().write(f"{line}\n")
        common = os.path.commonpath([file.path.absolute().parent for file in judged])
        for file in judged:
            counted = [
                {"": key, "scenes": value, "are": world.lint_means.get(key, "")} for key, value in file.counts.items()
            ]
            print_rows(counted, title=os.path.relpath(file.path.absolute(), common))  # full paths leave no room
    stderr().print(f"a target counts as visible with at least {world.visibility}")
    if missing := sum(bool(re.match("unknown object '[^']+:", problem.reason)) for _, problem in problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if problems:
        raise typer.Exit(1)


def _world_of(suite: str) -> Audited | None:
    """The world of ``WORLD:SUITE``, if it can audit its own initial states."""
    name, colon, _ = suite.partition(":")
    world = known_worlds().get(name) if colon else None
    return world if isinstance(world, Audited) else None


def _lint_suites(names: Sequence[str], states: int | None, *, json: bool, verbose: bool) -> None:
    """Print the verdicts on suites; the exit code is 1 when an initial state has a defect."""
    with Bar() as bar:
        worlds = [(name, _world_of(name)) for name in names]
        suites = [world.audit(name.partition(":")[2], states, bar) for name, world in worlds if world]
    if json:
        print_json([_document(suite) for suite in suites])
    else:
        for suite in suites:
            _print_suite(suite, verbose=verbose)
    if any(task.defects for suite in suites for task in suite.tasks):
        raise typer.Exit(1)


def _print_suite(suite: AuditedSuite, *, verbose: bool) -> None:
    for task in suite.tasks if verbose else ():
        for defect in task.defects:
            line = sentence(f"{task.name} state {defect.state}: {defect.check}: {defect.reason}")
            data().write(f"{line}\n")
    shown = [check for check in CHECKS if any(task.count(check) for task in suite.tasks)]
    rows = [
        {"task": task.name, "states": task.states, "sound": task.sound} | {check: task.count(check) for check in shown}
        for task in suite.tasks
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
        | {check: task.count(check) for check in CHECKS}
        | {"defects": [asdict(defect) for defect in task.defects]}
        for task in suite.tasks
    ]
    return {"suite": suite.suite, "with": suite.surroundings, "tasks": tasks}
