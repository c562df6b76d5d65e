"""``vlafuzz run``: one run, or one for each of several tasks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.campaign.options import AUTO
from vlafuzz.cli.flags import ConfigFlag, JsonFlag, TimeFlag, TrustFlag, configured, option, typed, with_run_options
from vlafuzz.cli.output import INTERRUPTED, print_json
from vlafuzz.common.plugins import command as command_line, is_reference
from vlafuzz.errors import PrerequisiteError, UsageError

if TYPE_CHECKING:
    from vlafuzz.cli.runs import Done


@with_run_options()
def command(
    *,
    world: Annotated[
        str | None,
        option(
            "Where: the name of a world, WORLD:TASK in place of --task, or python:pkg.mod:factory.",
            "the first of `vlafuzz list worlds`",
        ),
    ] = None,
    time: TimeFlag = None,
    resume: Annotated[
        bool,
        option("Resume a stored run that ended early; flags that are not given are taken from it.", flag="--resume"),
    ] = False,
    certify: Annotated[
        bool | None,
        option(
            "Then triage the scenes that show the commonest causes, at up to about twice its cost.",
            "with strategy causes",
            flag="--certify/--no-certify",
        ),
    ] = None,
    unchecked: Annotated[
        bool, option("Skip the check whether the policy sees, hears and moves.", flag="--unchecked", hidden=True)
    ] = False,
    trust: TrustFlag = False,
    config: ConfigFlag = None,
    json: JsonFlag = False,
    fail_on_finding: Annotated[
        bool, option("Exit with 1 when scenes fail.", flag="--fail-on-finding", hidden=True)
    ] = False,
    **given: Any,
) -> None:
    """Fuzz a policy: find scenes in which it fails, and with strategy causes why.

    Runs are kept in a store, by default runs/<task>-<policy>-<seed>.db; several tasks share one. Scenes that a store
    knows are answered from it at no cost. A policy of your own is first checked, for seconds: a blind policy, for
    example, is not run. With --time, half of it is for the run and what is left is for certification, if any; all of it
    is for the run where what is left would probably certify nothing. Several tasks share it.

    --config also has what is rarely changed: robot, batch, repeats, stop-early, unchecked; and
    fail-on-finding, for exit code 1 when scenes fail.
    """
    from vlafuzz.common.deadline import deadline

    until = deadline("--time", time)
    ours = not is_reference(world or given["task"] or "")
    _begin_early(given["policy"], given["workers"], given["executor"], ours=ours)
    from vlafuzz.campaign.config import RunConfig, plan as plan_of
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.runs import checked, run_plan, run_tasks, with_severity
    from vlafuzz.worlds import task_of, tasks_named

    named = task_of(world, given["task"])
    tasks, left = tasks_named(named) if named else (), ""
    flags = configured(given | {"task": named})
    if len(tasks) > 1:
        asked = partial(run_plan, certify=certify, json=json)
        runs, left = run_tasks(tasks, flags, asked, until, resume=resume, unchecked=unchecked, json=json)
    else:
        wanted = RunConfig(**flags, command=typed())
        runs = []
        if wanted.severity == AUTO and not resume:
            wanted, probe = with_severity(wanted, partial(run_plan, json=json), until)
            runs.append(probe)
        plan = resume_run(flags) if resume else plan_of(wanted)
        plan, speed = checked(plan, flags, unchecked=unchecked)
        runs.append(run_plan(plan, speed, until, certify=certify, json=json))
        if json:
            print_json(runs[-1].document)
    _end(runs, left, fail_on_finding=fail_on_finding)


def _begin_early(policy: str | None, workers: int | None, executor: str | None, *, ours: bool) -> None:
    """Begin what takes seconds and is most likely needed: what workers load, in a world of ours the simulator."""
    from vlafuzz.rollouts import forks
    from vlafuzz.rollouts.capacity import most_workers

    own = ":" in (policy or "")  # has one worker by default
    if executor in (None, "processes") and (workers or (1 if own else most_workers())) > 1:
        forks.load_early(ours=ours)


def _end(runs: Sequence[Done], left: str, *, fail_on_finding: bool) -> None:
    """End with the exit code of the results.

    Args:
        left: which tasks were not begun, in a sentence.
    """
    if any(done.interrupted for done in runs):
        raise typer.Exit(INTERRUPTED)
    for summary, _, again, _ in runs:
        of = f"{summary.task}: " * (len(runs) > 1)
        if summary.unjudged and not summary.verdicts["error"]:
            hint = "give it more --time"
            if summary.proposals:
                checks = ", ".join(f"{check} {count}" for check, count in summary.invalid.items())
                hint = f"no scene is fair ({checks}): narrower ranges leave room; of a file, `vlafuzz lint` says why"
            raise UsageError(f"{of}{summary.unjudged}", hint=hint)
        if summary.short:
            then = f"then `{again}` goes on" if summary.stopped else "the same command tries them again"
            doctor = command_line("doctor", "--policy", summary.policy)
            raise PrerequisiteError(f"{of}{summary.short}", hint=f"`{doctor}` says what is wrong; {then}")
    if left:
        raise UsageError(left, hint="give it more --time; with --resume it goes on")
    if fail_on_finding and any(done.summary.findings for done in runs):
        raise typer.Exit(1)
