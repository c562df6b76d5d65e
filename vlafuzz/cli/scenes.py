"""``vlafuzz lint``, ``vlafuzz lab coverage`` and how ``vlafuzz export`` reads VLATest's files."""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import CsvFlag, Frame, JsonFlag, PackFlag, PlacementFlag, opened, option
from vlafuzz.cli.output import Bar, data, print_json, print_rows, stderr, table
from vlafuzz.cli.suites import is_suite, lint_suites
from vlafuzz.common.files import writing
from vlafuzz.common.text import percent
from vlafuzz.errors import UsageError, check_number, sentence
from vlafuzz.lab.studies.coverage import SIZES, covered, tracks_of_files
from vlafuzz.model.conditions import check_choice
from vlafuzz.model.scene_lines import is_document, is_store, write_scenes
from vlafuzz.worlds import world_with
from vlafuzz.worlds.capabilities import PLACEMENTS, FileVerdicts, SceneFormats


def import_scenes(files: Sequence[Path], out: Path, frame: Frame, *, json: bool) -> None:
    """Write the scenes of VLATest's files as one file of ours, in order.

    Scenes with an object that has no counterpart in our catalogue are left out, with a note; in the frames original and
    robot none are.
    """
    if out.is_dir() or not out.parent.is_dir():
        raise UsageError(f"--out: cannot write {str(out)!r}", hint="give a file in a folder that exists")
    world = world_with(SceneFormats)
    with Bar() as bar:
        imported = [world.import_scenes(path, frame.value) for path in bar.track(files, "reading")]
    with writing(out):
        write_scenes(out, [scene for file in imported for scene in file.scenes])
    if frame is Frame.KEEP:
        moved = "`export --format vlatest` would move these scenes: it stretches them, as --frame fit does"
        Bar.note(f"note: {moved}")
    if missing := sum((Counter(file.missing) for file in imported), Counter[str]()):
        left_out = sum(file.left_out for file in imported)
        counterpart = "they have objects without a counterpart in our catalogue"
        stderr().print(f"{left_out} scenes are left out: {counterpart}")
        lacking = [{"no counterpart for": name, "scenes": count} for name, count in missing.most_common()]
        stderr().print(table(lacking))
    rows = [
        {"file": str(file.path), "scenes": file.read, "written": len(file.scenes), "left out": file.left_out}
        for file in imported
    ]
    if json:
        print_json([row | {"missing": file.missing} for row, file in zip(rows, imported, strict=True)])
    else:
        print_rows(rows, title=str(out))


_FRAME_HELP = "How VLATest's files are read: see `vlafuzz export --help`."
PACKED = re.compile("unknown object '[^']+:")  # a reason


def lint(
    files: Annotated[
        list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's; or a suite, WORLD:SUITE.")
    ],
    static: Annotated[
        bool | None,
        option(
            "Only what needs no simulator: semantics, geometry and visibility; or all.",
            "all; for VLATest's files --static, unless --placement is given",
            flag="--static/--settle",
        ),
    ] = None,
    frame: Annotated[Frame | None, option(_FRAME_HELP, "fit")] = None,
    min_distance: Annotated[
        float | None, option("Metres to keep between the centres of any two objects.", "0.15")
    ] = None,
    placement: PlacementFlag = None,
    pack: PackFlag = None,
    states: Annotated[int | None, option("Of a suite: the first initial states of each task.", "all")] = None,
    pictures: Annotated[
        Path | None, option("Of a suite: folder for a picture of each task's first state with each defect.")
    ] = None,
    verbose: Annotated[bool, option("Say what is wrong in each line.", flag="--verbose -v")] = False,
    json: JsonFlag = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, unseen (a target that cannot be seen in the policy's first picture), settling (a second
    of physics), not already solved. The exit code is 1 when a scene fails a check or a line is broken.

    For scenes with two or more objects: the shares in which two centres are closer than 0.15 m and 0.05 m, and in which
    footprints overlap. Unless --static, for all scenes whose objects are known, fair or not: the shares in which an
    object moves by more than 5 cm while settling, and in which the task is then solved, strictly or by the published
    criteria.

    Of suites of another world, the initial states are checked: what overlaps, slides, falls or still moves when a
    policy would begin, what is solved already, and what problem or instruction say and is not true.
    """
    check_number("--states", states, 1)
    of_files = {
        "--static": static,
        "--frame": frame,
        "--min-distance": min_distance,
        "--placement": placement,
        "--pack": pack,
    }
    suites = [str(name) for name in files if is_suite(name)]
    if suites and len(suites) < len(files):
        raise UsageError(f"files and suites at once: {suites[0]}", hint="lint them one after the other")
    if suites:
        _refuse(of_files, "a suite's initial states are checked as they are")
        lint_suites(suites, states, pictures, json=json, verbose=verbose)
        return
    _refuse({"--states": states, "--pictures": pictures}, "only suites have initial states")
    if min_distance is not None and not min_distance >= 0:
        raise UsageError(f"--min-distance: expected metres, got {min_distance}")
    put = check_choice("placement", placement or PLACEMENTS[0], PLACEMENTS)
    if static and placement:
        raise UsageError("--placement: with --static nothing is put down", hint="leave out one of the two")
    _check_frame(frame, files)
    linter, judged = world_with(SceneFormats).linter(opened(pack)), []
    with Bar() as bar:
        for path in files:
            quick = is_document(path) and not placement if static is None else static
            drop = None if quick else put
            judged.append(linter.lint(path, (frame or Frame.FIT).value, min_distance, drop, bar))
    _print(judged, linter.means, json=json, verbose=verbose)
    stderr().print(f"a target counts as visible with at least {linter.visibility}")
    if missing := sum(bool(PACKED.match(problem.reason)) for file in judged for problem in file.problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if any(file.problems for file in judged):
        raise typer.Exit(1)


def _refuse(flags: Mapping[str, object], reason: str) -> None:
    for flag, value in flags.items():
        if value is not None:
            raise UsageError(f"{flag}: {reason}", hint="leave it out")


def _check_frame(frame: Frame | None, files: list[Path]) -> None:
    if frame and not any(map(is_document, files)):
        raise UsageError(f"--frame {frame}: none of the files is one of VLATest", hint="leave it out")


def _print(judged: list[FileVerdicts], means: Mapping[str, str], *, json: bool, verbose: bool) -> None:
    if json:
        print_json([file.row() | {"rejections": [asdict(problem) for problem in file.problems]} for file in judged])
        return
    for file in judged if verbose else ():
        for problem in file.problems:
            line = sentence(f"{file.path}:{problem.line}: {problem.check}: {problem.reason}")
            data().write(f"{line}\n")
    common = os.path.commonpath([file.path.absolute().parent for file in judged])
    for file in judged:
        rows = [
            {"": key, "scenes": _count(value), "are": means.get(key, "")}
            for key, value in file.row().items()
            if key != "file"
        ]
        print_rows(rows, title=os.path.relpath(file.path.absolute(), common))  # full paths leave no room


def _count(value: object) -> str:
    """A number of scenes, or a share of them."""
    return percent(value) if isinstance(value, float) else str("–" if value is None else value)


def coverage(
    files: Annotated[
        list[Path], typer.Argument(help="Files of scenes, JSON lines or VLATest's; stores that runs wrote.")
    ],
    first: Annotated[
        list[int] | None, option("How many of the first scenes; may be repeated.", "10, 100, 1000")
    ] = None,
    frame: Annotated[Frame | None, option(_FRAME_HELP, "original")] = None,
    operators: Annotated[
        str | None, option("Ranges that files of ours are measured in: YAML, or a shipped one's name.", "tabletop")
    ] = None,
    json: JsonFlag = False,
    csv: CsvFlag = False,
) -> None:
    """Measure how much of the space scenes or runs cover.

    positions: the share of 10 x 10 cells of the box from which positions are drawn that hold the first object of a
    scene; published: the value in VLATest's paper. It grows with the number of scenes, whatever they contain. sites:
    distinct sets of operators far from nominal, with the target's place. For runs also cells: sites with the stage at
    which the policy was lost; failures: the cells of its failures.
    """
    sizes = first or list(SIZES)
    for size in sizes:
        check_number("--first", size, 1, 10**9)
    _check_frame(frame, files)
    if operators and all(map(is_store, files)):
        problem = f"--operators {operators}: the files are stores, whose runs have ranges of their own"
        raise UsageError(problem, hint="leave it out")
    rows: list[dict[str, Any]] = []
    with Bar() as bar:
        tracked = bar.track(files, "reading")
        for path, tracks in tracks_of_files(tracked, operators, (frame or Frame.ORIGINAL).value, bar.note):
            for track in tracks:
                origin = {"file": str(path), "run": track.run, "strategy": track.strategy}
                rows += [origin | asdict(row) for row in covered(track, sizes)]
    print_rows(rows, json=json, csv=csv, title="coverage")
