"""``vlafuzz study``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.output import print_json, print_rows, stderr, stdout
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.tasks.tabletop import TASKS

if TYPE_CHECKING:
    from vlafuzz.cli.studying import Study

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)

_Subjects = Annotated[
    list[str] | None,
    typer.Option(
        "--subject",
        help="The policy under test, or python:pkg.mod:factory; may be repeated.",
        show_default="mini, or pinhole where nothing renders",
    ),
]
_Out = Annotated[
    Path, typer.Option(help="Folder for study.json, study.md, stages.png and the store of all runs.")
]
_Tasks = Annotated[
    list[str] | None, typer.Option("--task", help="Only this task; may be repeated.", show_default="all four")
]
_Scenes = Annotated[int, typer.Option(help="Scenes a task, and a number of confounders in rq2.")]
_Operators = Annotated[str, typer.Option(help="YAML file of ranges, or a shipped one's name.")]
_Seed = Annotated[int, typer.Option(help="The same seed gives the same scenes.")]
_Workers = Annotated[int, typer.Option(help="Processes that evaluate scenes.")]
_Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.callback()
def _group() -> None:
    """Do an experiment of the VLATest paper with a subject. The same command goes on where it ended early."""


@app.command("rq1")
def rq1(
    out: _Out,
    subject: _Subjects = None,
    task: _Tasks = None,
    scenes: _Scenes = 100,
    operators: _Operators = "paper-rq1",
    pack: PackFlag = None,
    seed: _Seed = 0,
    workers: _Workers = 1,
    stores: Annotated[
        list[Path] | None,
        typer.Option("--from", help="Run nothing: count the runs of this store; may be repeated."),
    ] = None,
    json: _Json = False,
) -> None:
    """How far a subject comes in random scenes: the share that reaches each stage, for every task.

    The paper takes 1000 scenes a task. Its own shares of success stand beside. With --from it is about the
    random runs of stores, and those of files of scenes.
    """
    if stores:
        from vlafuzz.cli.studying import study_of

        _print(study_of(stores), out, json)
        return
    _study("rq1", out, subject, task, scenes, operators, pack, seed, workers, json)


@app.command("rq2")
def rq2(
    out: _Out,
    subject: _Subjects = None,
    task: _Tasks = None,
    scenes: _Scenes = 100,
    operators: _Operators = "paper-rq1",
    pack: PackFlag = None,
    seed: _Seed = 0,
    workers: _Workers = 1,
    json: _Json = False,
) -> None:
    """The same with 0, 1, 2, 3 and 4 confounders; and whether those that are like the target matter more.

    The paper takes 100 scenes a task and number.
    """
    _study("rq2", out, subject, task, scenes, operators, pack, seed, workers, json)


def _study(
    name: str,
    out: Path,
    subjects: list[str] | None,
    task: list[str] | None,
    scenes: int,
    operators: str,
    pack: list[str] | None,
    seed: int,
    workers: int,
    json: bool,
) -> None:
    from vlafuzz.cli.studying import study
    from vlafuzz.config import RunConfig

    for wanted in task or ():
        if wanted not in TASKS:
            raise UsageError(f"unknown task {wanted!r}", hint=suggestion(wanted, TASKS))
    asked = RunConfig(
        budget=scenes,
        seed=seed,
        operators=operators,
        packs=opened(pack),
        workers=workers,
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    try:
        named: list[str | None] = [*dict.fromkeys(subjects or ())] or [None]
        made = study(name, asked, list(dict.fromkeys(task or TASKS)), named, out)
    except KeyboardInterrupt:
        stderr().print(
            "interrupted: all scenes so far are stored\nhint: the same command goes on", soft_wrap=True
        )
        raise typer.Exit(130) from None
    _print(made, out, json)


def _print(made: Study, out: Path, json: bool) -> None:
    from vlafuzz.cli.studying import write

    told = write(made, out)
    if json:
        print_json(told)
        return
    from vlafuzz.studies.sheet import NOTE, stage_rows

    print_rows(stage_rows(made.standings, made.published), title=made.title)
    stdout().print(NOTE, soft_wrap=True)
    stderr().print(f"written to {out}: study.json, study.md, stages.png")
