"""``vlafuzz lint``: verdicts on files of scenes."""

import os
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, opened, option
from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.common.plugins import is_reference, trust
from vlafuzz.common.text import plural
from vlafuzz.errors import UsageError, sentence
from vlafuzz.worlds import known_worlds, parted, task_of, world_named


def lint(
    files: Annotated[
        list[str], typer.Argument(help="Files of scenes, JSON lines; or worlds as --world of `run` names them.")
    ],
    static: Annotated[bool, option("Only what needs no simulator: semantics, geometry and visibility.")] = False,
    pack: PackFlag = None,
    json: JsonFlag = False,
) -> None:
    """Check whether the scenes of a file are fair, or whether the tasks of a world or of a suite can be believed.

    Checks: semantic, geometry, unseen (a target that cannot be seen in the policy's first picture, by the bounds that
    `vlafuzz list operators` shows), settling (a second of physics), not already solved. The exit code is 1 when a scene
    fails a check or a line is broken.

    A world, as WORLD:SUITE or python:pkg.mod:factory: words with identifiers, empty ones, words that name what is
    not in the scene, the same words for other goals, and tasks that are solved by doing nothing (not with --static).
    """
    worlds = [name for name in files if is_reference(name) or parted(name)[0] in known_worlds()]
    if worlds:
        if len(worlds) < len(files) or pack:
            raise UsageError("files and worlds are linted apart, and worlds without --pack", hint=f"lint {worlds[0]}")
        _lint_worlds(worlds, static=static, json=json)
        return
    from vlafuzz.worlds.lint import MEANS, lint as verdicts

    packs = opened(pack)
    with Bar() as bar:
        judged = [verdicts(Path(path), packs, bar, settle=not static) for path in files]
    problems = [(f"{file.path}:{line}", problem) for file in judged for line, problem in file.problems.items()]
    if json:
        rows = [[{"line": line, **asdict(problem)} for line, problem in file.problems.items()] for file in judged]
        files_told = zip(judged, rows, strict=True)
        print_json([{"file": str(file.path), **file.counts, "rejections": found} for file, found in files_told])
    else:
        for place, problem in problems:
            data().write(f"{sentence(f'{place}: {problem.check}: {problem.reason}')}\n")
        common = os.path.commonpath([file.path.absolute().parent for file in judged])
        for file in judged:
            counted = [{"": key, "scenes": value, "are": MEANS.get(key, "")} for key, value in file.counts.items()]
            print_rows(counted, title=os.path.relpath(file.path.absolute(), common))  # full paths leave no room
    if missing := sum(bool(re.match("unknown object '[^']+:", problem.reason)) for _, problem in problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if problems:
        raise typer.Exit(1)


def _lint_worlds(names: list[str], *, static: bool, json: bool) -> None:
    """Print a line for each problem of the tasks of worlds, or of their suites."""
    from vlafuzz.doctor.suites import Problem, of_words, when_still

    found, tasks = list[Problem](), 0
    with Bar() as bar:
        for given in names:
            name, suite = parted(given)
            if is_reference(name):
                trust(name)  # the user named it
            prompts = list(world_named(name).prompts(suite))
            tasks += len(prompts)
            found += of_words(prompts)
            for number, prompt in enumerate([] if static else prompts):
                bar.progress(given, number, len(prompts))
                found += when_still(task_of(name, prompt.task) or prompt.task)
    if json:
        print_json([problem._asdict() for problem in found])
    for problem in [] if json else found:
        data().write(f"{sentence(f'{problem.task}: {problem.check}: {problem.found}')}\n")
    stderr().print(f"{plural(len({problem.task for problem in found}), 'task')} of {tasks} with a problem")
    if found:
        raise typer.Exit(1)
