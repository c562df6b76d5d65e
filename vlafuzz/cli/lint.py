"""``vlafuzz lint``: verdicts on files of scenes."""

import os
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, opened, option
from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr
from vlafuzz.errors import UsageError, sentence
from vlafuzz.model.scene_lines import Frame, is_document


def lint(
    files: Annotated[list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's.")],
    static: Annotated[
        bool | None,
        option(
            "Only what needs no simulator: semantics, geometry and visibility; or all.",
            "all; for VLATest's files --static",
            flag="--static/--settle",
        ),
    ] = None,
    frame: Annotated[Frame | None, option("How VLATest's files are read: see `vlafuzz export --help`.", "fit")] = None,
    pack: PackFlag = None,
    verbose: Annotated[bool, option("Say what is wrong in each line.", flag="--verbose -v")] = False,
    json: JsonFlag = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, unseen (a target that cannot be seen in the policy's first picture), settling (a second
    of physics), not already solved. The exit code is 1 when a scene fails a check or a line is broken.
    """
    if frame and not any(map(is_document, files)):
        raise UsageError(f"--frame {frame}: none of the files is one of VLATest", hint="leave it out")
    from vlafuzz.worlds.manipulation.operator_set import load_operators
    from vlafuzz.worlds.tabletop import lint as tabletop

    packs, judged = opened(pack), list[tabletop.FileVerdicts]()
    with Bar() as bar:
        for path in files:
            quick = is_document(path) if static is None else static
            judged.append(tabletop.lint(path, frame or "fit", packs, bar, settle=not quick))
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
                {"": key, "scenes": value, "are": tabletop.MEANS.get(key, "")} for key, value in file.counts.items()
            ]
            print_rows(counted, title=os.path.relpath(file.path.absolute(), common))  # full paths leave no room
    stderr().print(f"a target counts as visible with at least {load_operators().visible}")
    if missing := sum(bool(re.match("unknown object '[^']+:", problem.reason)) for _, problem in problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if problems:
        raise typer.Exit(1)
