"""``vlafuzz lab``: studies of the VLATest paper, and how much of the space scenes cover."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import CsvFlag, JsonFlag, PackFlag, RobotFlag, SeedFlag, WorkersFlag, opened, option, option_of
from vlafuzz.cli.lint import FRAME_HELP, check_frame
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_rows
from vlafuzz.errors import UsageError, check_number, suggestion
from vlafuzz.model.scene_lines import is_store
from vlafuzz.worlds import usual_world
from vlafuzz.worlds.capabilities import Frame

STUDIES = ("rq1", "rq2", "rq3", "rq4", "rq5", "rq6", "prompts")


def study(
    study: Annotated[str, typer.Argument(help="Which one: " + ", ".join(STUDIES) + ".")],
    out: Annotated[Path, option("Folder for STUDY.json, STUDY.md, STUDY.png and the store of all runs.")],
    policy: Annotated[
        list[str] | None, option_of("policy", "mini, or pinhole where nothing renders", more="May be repeated.")
    ] = None,
    task: Annotated[list[str] | None, option_of("task", "all that the study has", more="May be repeated.")] = None,
    scenes: Annotated[int, option("Scenes a task, and a number of confounders in rq2.", flag="--scenes --n")] = 100,
    robot: RobotFlag = None,
    operators: Annotated[str | None, option_of("operators", "paper-rq1, or those of another robot")] = None,
    pack: PackFlag = None,
    unseen: Annotated[
        list[str] | None, option("The pack of rq5's unseen objects, a folder or a name; may be repeated.")
    ] = None,
    seed: SeedFlag = 0,
    workers: WorkersFlag = None,
    json: JsonFlag = False,
) -> None:
    """Do an experiment of the VLATest paper with policies, side by side.

    \b
    rq1      how far a policy comes in random scenes (the paper: 1000 a task)
    rq2      the same with 0, 1, 2, 3 and 4 confounders (100 a task and number)
    rq3      scenes that it passed, in other light; beside an unmutated control
    rq4      the same with the camera moved and turned
    rq5      seen objects against those of --unseen PACK
    rq6      ten paraphrases of every instruction, beside the plain one
    prompts  both steps in one instruction; and one step at a time

    The same command continues after an interruption. Studies with the same --out share
    their runs.
    """  # noqa: D301 - click's mark for lines that stay as they are
    tasks = usual_world().tasks
    if study not in STUDIES:
        raise UsageError(f"unknown study {study!r}", hint=suggestion(study, STUDIES))
    if unknown := next((name for name in task or () if name not in tasks), None):
        raise UsageError(f"unknown task {unknown!r}", hint=suggestion(unknown, tasks))
    if (study == "rq5") != bool(unseen):
        raise UsageError(
            f"{study}: --unseen {'is missing' if study == 'rq5' else 'is for rq5 only'}",
            hint="`vlafuzz lab study rq5 --unseen DIR`: the pack of objects that no policy has seen",
        )
    check_number("--scenes", scenes, 1)
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.doctor.exam import speed_of
    from vlafuzz.lab.studies.result import write
    from vlafuzz.lab.studies.study import StudyRequest, ranges_for
    from vlafuzz.lab.studies.study import study as run_study

    request = StudyRequest(
        study,
        tasks=list(dict.fromkeys(task or ())),
        policies=[*dict.fromkeys(policy or ())] or [None],
        unseen=opened(unseen),
    )
    run = RunConfig(
        budget=scenes,
        seed=seed,
        robot=robot,
        operators=operators or ranges_for(robot),
        packs=opened(pack),
        workers=workers,
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    with interruptible("interrupted: all scenes so far are stored\nhint: the same command continues") as bar:
        result = run_study(request, run, out, bar, speed_of)
    document = write(result, out)
    if json:
        print_json(document)
        return
    print_rows(result.rows(), title=result.title)
    print_lines(*result.said())


def coverage(
    files: Annotated[
        list[Path], typer.Argument(help="Files of scenes, JSON lines or VLATest's; stores that runs wrote.")
    ],
    first: Annotated[
        list[int] | None, option("How many of the first scenes; may be repeated.", "10, 100, 1000")
    ] = None,
    frame: Annotated[Frame | None, option(FRAME_HELP, "original")] = None,
    operators: Annotated[
        str | None, option_of("operators", "tabletop", more="Files of ours are measured in these ranges.")
    ] = None,
    json: JsonFlag = False,
    csv: CsvFlag = False,
) -> None:
    """Measure how much of the space scenes or runs cover.

    positions: the share of 10 x 10 cells of the box from which positions are drawn that hold the first object of a
    scene, as in VLATest's paper. It grows with the number of scenes, whatever they contain. sites: distinct sets of
    operators far from nominal, with the target's place. For runs also cells: sites with the stage at which the policy
    was lost; failures: the cells of its failures.
    """
    from vlafuzz.lab.studies.coverage import SIZES, covered, tracks_of_files

    sizes = first or list(SIZES)
    for size in sizes:
        check_number("--first", size, 1, 10**9)
    check_frame(frame, files)
    if operators and all(map(is_store, files)):
        problem = f"--operators {operators}: the files are stores, whose runs have ranges of their own"
        raise UsageError(problem, hint="leave it out")
    rows: list[dict[str, Any]] = []
    with Bar() as bar:
        tracked = bar.track(files, "reading")
        for path, tracks in tracks_of_files(tracked, operators, frame or "original", bar.note):
            for track in tracks:
                origin = {"file": str(path), "run": track.run, "strategy": track.strategy}
                rows += [origin | asdict(row) for row in covered(track, sizes)]
    print_rows(rows, json=json, csv=csv, title="coverage")
