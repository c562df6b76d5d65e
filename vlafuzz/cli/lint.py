"""``vlafuzz lint``: verdicts on files of scenes."""

import os
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, opened, option
from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.errors import sentence


def lint(
    files: Annotated[list[Path], typer.Argument(help="Files of scenes, JSON lines.")],
    static: Annotated[bool, option("Only what needs no simulator: semantics, geometry and visibility.")] = False,
    pack: PackFlag = None,
    verbose: Annotated[bool, option("Say what is wrong in each line.", flag="--verbose -v")] = False,
    json: JsonFlag = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, unseen (a target that cannot be seen in the policy's first picture, by the bounds that
    `vlafuzz list operators` shows), settling (a second of physics), not already solved. The exit code is 1 when a scene
    fails a check or a line is broken.
    """
    from vlafuzz.worlds.lint import MEANS, lint as verdicts

    packs = opened(pack)
    with Bar() as bar:
        judged = [verdicts(path, packs, bar, settle=not static) for path in files]
    problems = [(f"{file.path}:{line}", problem) for file in judged for line, problem in file.problems.items()]
    if json:
        rows = [[{"line": line, **asdict(problem)} for line, problem in file.problems.items()] for file in judged]
        files_told = zip(judged, rows, strict=True)
        print_json([{"file": str(file.path), **file.counts, "rejections": found} for file, found in files_told])
    else:
        for place, problem in problems if verbose else ():
            data().write(f"{sentence(f'{place}: {problem.check}: {problem.reason}')}\n")
        common = os.path.commonpath([file.path.absolute().parent for file in judged])
        for file in judged:
            counted = [{"": key, "scenes": value, "are": MEANS.get(key, "")} for key, value in file.counts.items()]
            print_rows(counted, title=os.path.relpath(file.path.absolute(), common))  # full paths leave no room
    if missing := sum(bool(re.match("unknown object '[^']+:", problem.reason)) for _, problem in problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if problems:
        raise typer.Exit(1)
