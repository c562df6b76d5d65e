"""``vlafuzz lab study``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, RobotFlag, WorkersFlag, opened, option
from vlafuzz.cli.output import interruptible, print_json, print_rows, stdout
from vlafuzz.errors import UsageError, check_number, suggestion
from vlafuzz.worlds import usual_world

if TYPE_CHECKING:
    from vlafuzz.lab.studies.sheet import StudyResult

STUDIES = ("rq1", "rq2", "rq3", "rq4", "rq5", "rq6", "prompts")
ALPHAS = ("linear", "log")


def command(
    study: Annotated[str, typer.Argument(help="Which one: " + ", ".join(STUDIES) + ".")],
    out: Annotated[Path, option("Folder for STUDY.json, STUDY.md, STUDY.png and the store of all runs.")],
    policy: Annotated[
        list[str] | None,
        option(
            "The policy under test, or python:pkg.mod:factory; may be repeated.",
            "mini, or pinhole where nothing renders",
        ),
    ] = None,
    task: Annotated[list[str] | None, option("Only this task; may be repeated.", "all that the study has")] = None,
    scenes: Annotated[int, option("Scenes a task, and a number of confounders in rq2.", flag="--scenes --n")] = 100,
    robot: RobotFlag = None,
    operators: Annotated[
        str | None, option("YAML file of ranges, or a shipped one's name.", "paper-rq1, or those of another robot")
    ] = None,
    pack: PackFlag = None,
    alpha: Annotated[str, option("How rq3 draws the light: linear, as the paper, or log, evenly in log2.")] = "linear",
    unseen: Annotated[
        list[str] | None, option("The pack of rq5's unseen objects, a folder or a name; may be repeated.")
    ] = None,
    seed: Annotated[int, option("The same seed gives the same scenes.")] = 0,
    workers: WorkersFlag = None,
    stores: Annotated[
        list[Path] | None, option("Run nothing: rq1 of the runs of this store; may be repeated.", flag="--from")
    ] = None,
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
    their runs. With --from, rq1 counts the stored runs of random scenes and of files
    of scenes.
    """  # noqa: D301 - click's mark for lines that stay as they are
    if study not in STUDIES:
        raise UsageError(f"unknown study {study!r}", hint=suggestion(study, STUDIES))
    if alpha not in ALPHAS:
        raise UsageError(f"unknown --alpha {alpha!r}", hint=suggestion(alpha, ALPHAS))
    if (study == "rq5") != bool(unseen):
        raise UsageError(
            f"{study}: --unseen {'is missing' if study == 'rq5' else 'is for rq5 only'}",
            hint="`vlafuzz lab study rq5 --unseen DIR`: the pack of objects that no policy has seen",
        )
    check_number("--scenes", scenes, 1)
    for name in task or ():
        if name not in usual_world().tasks:
            raise UsageError(f"unknown task {name!r}", hint=suggestion(name, usual_world().tasks))
    if stores and study != "rq1":
        raise UsageError(f"{study}: --from is for rq1 only", hint="leave it out")
    runs = {"--task": task, "--policy": policy, "--robot": robot, "--operators": operators, "--pack": pack}
    if stores and (flags := [flag for flag, value in runs.items() if value]):
        raise UsageError(f"{flags[0]} and --from: nothing is run", hint="leave one of the two out")

    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.doctor.before_run import speed_of
    from vlafuzz.lab.studies.study import StudyRequest, ranges_for, study_of
    from vlafuzz.lab.studies.study import study as run_study

    if stores:
        _print(study_of(stores), out, json)
        return
    request = StudyRequest(
        study,
        tasks=list(dict.fromkeys(task or ())),
        policies=[*dict.fromkeys(policy or ())] or [None],
        alpha=alpha,  # type: ignore[arg-type] # one of ALPHAS
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
    _print(result, out, json)


def _print(result: StudyResult, out: Path, json: bool) -> None:
    from vlafuzz.lab.studies.study import write

    document = write(result, out)
    if json:
        print_json(document)
        return
    tables, notes = result.sheet()
    for table in tables:
        print_rows(table.rows, title=table.title)
    for text in notes:
        stdout().print(text, soft_wrap=True)
