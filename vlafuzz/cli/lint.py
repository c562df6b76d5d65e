"""``vlafuzz lint``."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import PlacementFlag
from vlafuzz.cli.import_ import Frame
from vlafuzz.cli.output import Bar, print_json, print_rows, stderr
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.conditions.conditions import PLACEMENTS, check_choice
from vlafuzz.diagnostics.lint import Verdicts, lint
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.formats.scene_lines import is_vlatest, read_scene_file
from vlafuzz.objects.catalogue import load_catalogue
from vlafuzz.space.operator_set import load_operators

PACKED = re.compile("unknown object '[^']+:")  # a reason


def command(
    files: Annotated[list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's.")],
    static: Annotated[
        bool | None,
        typer.Option(
            "--static/--settle",
            help="Only what needs no simulator, semantics and geometry; or all.",
            show_default="all; for VLATest's files --static, unless --placement is given",
        ),
    ] = None,
    frame: Annotated[
        Frame, typer.Option(help="How VLATest's files are read: see `vlafuzz import vlatest`.")
    ] = Frame.FIT,
    min_distance: Annotated[
        float | None,
        typer.Option(help="Metres to keep between the centres of any two objects.", show_default="0.15"),
    ] = None,
    placement: PlacementFlag = None,
    pack: PackFlag = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is wrong in each line.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, each rejection with its line.")] = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, settling (a second of physics), not already solved. The exit code is 1 when a
    scene fails a check or a line is broken.

    For scenes with two or more objects: the shares in which two centres are closer than 0.15 m and 0.05 m,
    and in which footprints overlap. Unless --static, for all scenes whose objects are known, fair or not: the
    shares in which an object moves by more than 5 cm while settling, and in which the task is then solved,
    strictly or by the published criteria.
    """
    if min_distance is not None and not min_distance >= 0:
        raise UsageError(f"--min-distance: expected metres, got {min_distance}")
    keep = load_operators().min_distance if min_distance is None else min_distance
    put = check_choice("placement", placement or PLACEMENTS[0], PLACEMENTS)
    if static and placement:
        raise UsageError("--placement: with --static nothing is put down", hint="leave out one of the two")
    catalogue = load_catalogue(packs=opened(pack))
    with Bar() as bar:
        judged = []
        for path in files:
            quick = is_vlatest(path) and not placement if static is None else static
            source = read_scene_file(path, catalogue, frame.value)
            if not (source.lines or source.left_out):
                raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")
            judged.append(lint(source, catalogue, keep, None if quick else put, bar))
    _print(judged, json=json, verbose=verbose)
    if missing := sum(bool(PACKED.match(problem.reason)) for file in judged for problem in file.problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if any(file.problems for file in judged):
        raise typer.Exit(1)


def _print(judged: list[Verdicts], *, json: bool, verbose: bool) -> None:
    rows = [file.row() for file in judged]
    if json:
        rejections = [[asdict(problem) for problem in file.problems] for file in judged]
        print_json([row | {"rejections": lines} for row, lines in zip(rows, rejections, strict=True)])
        return
    if verbose:
        for file in judged:
            for problem in file.problems:
                typer.echo(f"{file.path}:{problem.line}: {problem.check}: {problem.reason}")
    print_rows(rows, title="scenes")
