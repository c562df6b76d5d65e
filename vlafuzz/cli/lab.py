"""``vlafuzz lab study``: the experiments of the VLATest paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import JsonFlag, configured, opened, option, option_of, typed, with_run_options
from vlafuzz.cli.output import interruptible, print_json, print_lines, print_rows
from vlafuzz.errors import UsageError, check_number, suggestion
from vlafuzz.worlds import usual_world

STUDIES = ("rq1", "rq2", "rq3", "rq4", "rq5", "rq6", "prompts")


@with_run_options("robot", "operators", "packs", "seed", "workers", operators="paper-rq1, or those of another robot")
def study(
    study: Annotated[str, typer.Argument(help="Which one: " + ", ".join(STUDIES) + ".")],
    out: Annotated[Path, option("Folder for STUDY.json, STUDY.md and the store of all runs.")],
    policy: Annotated[
        list[str] | None, option_of("policy", "mini, or pinhole where nothing renders", more="May be repeated.")
    ] = None,
    task: Annotated[list[str] | None, option_of("task", "all that the study has", more="May be repeated.")] = None,
    scenes: Annotated[int, option("Scenes a task, and a number of confounders in rq2.", flag="--scenes --n")] = 100,
    unseen: Annotated[
        list[str] | None, option("The pack of rq5's unseen objects, a folder or a name; may be repeated.")
    ] = None,
    json: JsonFlag = False,
    **given: Any,
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
    ranges = {"operators": given["operators"] or ranges_for(given["robot"])}
    run = RunConfig(**configured(given) | ranges, budget=scenes, command=typed())
    with interruptible("interrupted: all scenes so far are stored\nhint: the same command continues") as bar:
        result = run_study(request, run, out, bar, speed_of)
    document = write(result, out)
    if json:
        print_json(document)
        return
    print_rows(result.rows(), title=result.title)
    print_lines(*result.said())
