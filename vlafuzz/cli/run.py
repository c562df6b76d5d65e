"""``vlafuzz run``: one run, or one for each of several tasks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.campaign.options import AUTO, LEAST
from vlafuzz.cli.flags import ConfigFlag, JsonFlag, TimeFlag, TrustFlag, configured, option, typed, with_run_options
from vlafuzz.cli.output import INTERRUPTED, Bar, print_json, print_rows
from vlafuzz.common.plugins import command as command_line
from vlafuzz.errors import PrerequisiteError, UsageError

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan, RunConfig
    from vlafuzz.campaign.forecast import Speed
    from vlafuzz.cli.one_run import Done
    from vlafuzz.common.deadline import Deadline

# Share of the budget that is spent to find the severity at which one half fails, and the fewest rollouts for it. With
# 60 rollouts, the 95 % interval of that severity is 0.17 to 0.28 wide in simulation.
PROBING, FEWEST = 0.25, 20


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
    _begin_early(given["policy"], given["workers"], given["executor"])
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.one_run import run_plan
    from vlafuzz.worlds import task_of, tasks_named

    named = task_of(world, given["task"])
    tasks, left = tasks_named(named) if named else (), ""
    flags = configured(given | {"task": named})
    if len(tasks) > 1:
        asked = partial(run_plan, certify=certify, json=json)
        runs, left = _run_tasks(tasks, flags, asked, until, resume=resume, unchecked=unchecked, json=json)
    else:
        wanted = RunConfig(**flags, command=typed())
        runs = []
        if wanted.severity == AUTO and not resume:
            wanted, probe = _with_severity(wanted, partial(run_plan, json=json), until)
            runs.append(probe)
        plan = resume_run(flags) if resume else plan_of(wanted)
        plan, speed = _checked(plan, flags, unchecked=unchecked)
        runs.append(run_plan(plan, speed, until, certify=certify, json=json))
        if json:
            print_json(runs[-1].document)
    _end(runs, left, fail_on_finding=fail_on_finding)


def _with_severity(config: RunConfig, run_plan: Callable[..., Done], until: Deadline) -> tuple[RunConfig, Done]:
    """The configuration with the severity at which about one half fails, and the run that found it out.

    What that run leaves of the budget is for the run that follows.
    """
    from vlafuzz.campaign.config import BUDGET
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.report.tables import half_of_run
    from vlafuzz.search.severity import NAME
    from vlafuzz.store.store import Store

    budget = config.budget or BUDGET
    probing = replace(config, severity=1.0, strategy=NAME, like=None, budget=max(FEWEST, int(budget * PROBING)))
    plan = plan_of(probing)
    done = run_plan(plan, None, until.after(0.5), certify=False)
    with Store.open(plan.store) as store:
        half = half_of_run(store, done.summary.run)
    severity = min(max(round(half.value, 2), LEAST), 1.0)
    Bar.note(f"severity {severity:g}: about one half fails there")
    left = max(budget - done.summary.rollouts, config.repeats)
    return replace(config, store=plan.store, severity=severity, budget=left), done


def _begin_early(policy: str | None, workers: int | None, executor: str | None) -> None:
    """Begin what takes seconds and is most likely needed: the usual world, and the simulator for workers."""
    from vlafuzz.rollouts import forks
    from vlafuzz.rollouts.capacity import most_workers
    from vlafuzz.worlds import known_worlds

    next(iter(known_worlds().values())).begin_early(policy)
    own = ":" in (policy or "")  # has one worker by default
    if executor in (None, "processes") and (workers or (1 if own else most_workers())) > 1:
        forks.load_early()


def _checked(plan: Plan, flags: Mapping[str, Any], *, unchecked: bool) -> tuple[Plan, Speed | None]:
    """The plan after the check of its policy."""
    from vlafuzz.doctor.exam import checked_plan

    if plan.resume is None:
        note_policy(plan, flags)
    with Bar() as bar:
        return checked_plan(plan, unchecked=unchecked, watch=bar)


def note_policy(plan: Plan, flags: Mapping[str, Any]) -> None:
    """Say why a policy was chosen that needs no pictures."""
    from vlafuzz.worlds import no_pictures, world_of

    task = plan.manifest.task
    usual = next(iter(world_of(task).robots))
    if "policy" not in flags and plan.manifest.robot == usual and no_pictures(task):
        hint = "`vlafuzz doctor` says what to install"
        Bar.note(f"note: nothing here draws pictures, so the policy is {plan.manifest.policy}; {hint}")


def _run_tasks(
    tasks: Sequence[str],
    flags: Mapping[str, Any],
    run_plan: Callable[..., Done],
    until: Deadline,
    *,
    resume: bool,
    unchecked: bool,
    json: bool,
) -> tuple[list[Done], str]:
    """Run each task with the same flags, up to the first interruption, and print how policies do in them.

    All share one store and the time that is left, and the policy is checked once. With ``resume``, runs that ended
    early are taken up again, and those that are over are not repeated.

    Returns:
        The runs, and in a sentence which tasks were not begun as the time was over.
    """
    from vlafuzz.campaign.config import RunConfig, default_store
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.campaign.resume import begun
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.report.tables import standings_of
    from vlafuzz.store.records import UNFINISHED
    from vlafuzz.store.store import Store
    from vlafuzz.worlds import default_policy, tasks_named

    policy = flags.get("policy") or default_policy(tasks[0], flags.get("robot"))
    name = "all" if set(tasks) == set(tasks_named("all")) else "-".join(tasks)
    path = flags.get("store") or default_store(name, policy, flags.get("seed", 0))
    shared = {**flags, "store": path, "policy": policy}
    config = RunConfig(**{**shared, "task": None}, command=typed())
    again = command_line(*(word for word in sys.argv[1:] if word != "--resume"), "--resume")
    first, left = None, ""
    runs: list[Done] = []
    for number, task in enumerate(tasks):
        if until.passed:
            left = f"--time was over before these tasks began: {', '.join(tasks[number:])}"
            break
        Bar.note(f"task {number + 1} of {len(tasks)}: {task}")
        asked = {**shared, "task": task}
        before = begun(asked) if resume else None
        if before and before.status not in UNFINISHED:
            Bar.note(f"run {before.id} of it is over")
            continue
        ready = replace(config, task=task)
        if config.severity == AUTO and not before:
            ready, _ = _with_severity(ready, run_plan, until.after(1 / (len(tasks) - number)))
        plan = resume_run(asked) if before else plan_of(ready)
        foreseen, remaining = 0, len(tasks) - number
        if first is None:
            first, foreseen = _checked(plan, flags, unchecked=unchecked), remaining
            plan = first[0]
        elif plan.resume is None:
            plan = replace(plan, manifest=replace(plan.manifest, checkup=first[0].manifest.checkup))
        runs.append(run_plan(plan, first[1], until.after(1 / remaining), tasks=foreseen, again=again))
        if runs[-1].interrupted:
            Bar.note(f"hint: `{again}` does the other tasks")
            break
    with Store.open(path) as store:
        rows = standings_of(store)
    if json:
        print_json({"tasks": [done.document for done in runs], "standings": [one.document() for one in rows]})
    else:
        print_rows([one.row() for one in rows], title=f"policies and tasks of {path}")
    return runs, left


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
                export = command_line("export", summary.store, "--verdict", "all", "--out", "F.jsonl")
                hint = f"no scene is fair ({checks}): `{export}` writes them, `vlafuzz lint -v F.jsonl` says why"
            raise UsageError(f"{of}{summary.unjudged}", hint=hint)
        if summary.short:
            then = f"then `{again}` goes on" if summary.stopped else "the same command tries them again"
            doctor = command_line("doctor", "--policy", summary.policy)
            raise PrerequisiteError(f"{of}{summary.short}", hint=f"`{doctor}` says what is wrong; {then}")
    if left:
        raise UsageError(left, hint="give it more --time; with --resume it goes on")
    if fail_on_finding and any(done.summary.findings for done in runs):
        raise typer.Exit(1)
