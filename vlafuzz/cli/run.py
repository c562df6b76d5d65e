"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli import after_run
from vlafuzz.cli.config_file import ConfigFlag
from vlafuzz.cli.early import begin_early
from vlafuzz.cli.flags import (
    AddressFlag,
    ExecutorFlag,
    LabelFlag,
    OperatorsFlag,
    PackFlag,
    PlacementFlag,
    PolicyFlag,
    RobotFlag,
    TimeFlag,
    TrustFlag,
    VaryFlag,
    WorkersFlag,
    listed,
    opened,
)
from vlafuzz.cli.output import INTERRUPTED, Bar, interruptible, print_json
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError
from vlafuzz.plugins import trust_flag

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.deadline import Deadline


def command(
    task: Annotated[
        str | None, typer.Option(help="What the robot is told to do.", show_default="pick-up")
    ] = None,
    world: Annotated[
        str | None,
        typer.Option(
            help="Where: tabletop, or libero:SUITE/NUMBER in place of --task.", show_default="tabletop"
        ),
    ] = None,
    robot: RobotFlag = None,
    policy: PolicyFlag = None,
    label: LabelFlag = None,
    strategy: Annotated[
        str | None,
        typer.Option(
            help="What proposes scenes, or python:pkg.mod:factory.",
            show_default="causes; with a pool surrogate",
        ),
    ] = None,
    budget: Annotated[int | None, typer.Option(help="Policy rollouts.", show_default="100")] = None,
    time: TimeFlag = None,
    seed: Annotated[
        int | None, typer.Option(help="The same seed gives the same scenes.", show_default="0")
    ] = None,
    operators: OperatorsFlag = None,
    vary: VaryFlag = None,
    scenes: Annotated[Path | None, typer.Option(help="Run every scene of this file once.")] = None,
    pool: Annotated[
        Path | None, typer.Option(help="The strategy chooses from the scenes of this file.")
    ] = None,
    pack: PackFlag = None,
    store: Annotated[
        Path | None,
        typer.Option(help="The store; an existing one gets another run.", show_default="runs/….db"),
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(
            help="Proposals that are evaluated at a time.",
            show_default="16; for causes a 75th of the budget, at least 4; for random 64",
        ),
    ] = None,
    repeats: Annotated[
        int | None, typer.Option(help="Rollouts per scene; it fails if one of them fails.", show_default="1")
    ] = None,
    stop_early: Annotated[
        bool | None, typer.Option("--stop-early", help="End a rollout at its first success.")
    ] = None,
    criteria: Annotated[
        str | None, typer.Option(help="What success means: strict, or published.", show_default="strict")
    ] = None,
    placement: PlacementFlag = None,
    workers: WorkersFlag = None,
    executor: ExecutorFlag = None,
    address: AddressFlag = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Resume a stored run that ended early; flags that are not given are taken from it.",
        ),
    ] = False,
    triage: Annotated[
        bool, typer.Option("--triage", help="Then triage the store, as `vlafuzz triage` does.")
    ] = False,
    certify: Annotated[
        bool | None,
        typer.Option(
            "--certify/--no-certify",
            help="Then triage the scenes that show the commonest causes, at up to about twice its cost.",
            show_default="with strategy causes",
        ),
    ] = None,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="Skip the check whether the policy sees, hears and moves.")
    ] = False,
    trust: TrustFlag = False,
    config: ConfigFlag = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    fail_on_finding: Annotated[
        bool, typer.Option("--fail-on-finding", help="Exit with 1 when scenes fail.")
    ] = False,
) -> None:
    """Fuzz a policy: find scenes in which it fails, and with strategy causes why.

    Runs are kept in a store, by default runs/<task>-<policy>-<seed>.db. Scenes that a store knows
    are answered from it at no cost. A policy of your own is first checked, for seconds: a blind policy,
    for example, is not run. With --time, half of it is for the run and what is left is for triage, if any;
    all of it is for the run where what is left would probably certify nothing.
    """
    from vlafuzz.deadline import deadline

    until = deadline("--time", time)
    begin_early(policy, workers, executor)
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.launch import SEARCH
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.summary import print_summary
    from vlafuzz.diagnostics.before_run import checked_plan
    from vlafuzz.search.base import about, looks_for_causes
    from vlafuzz.triage.jobs import Allowance
    from vlafuzz.worlds import task_of

    values = {
        "task": task_of(world, task),
        "robot": robot,
        "policy": policy,
        "label": label,
        "strategy": strategy,
        "budget": budget,
        "seed": seed,
        "batch": batch,
        "repeats": repeats,
        "stop_early": stop_early,
        "criteria": criteria,
        "placement": placement,
        "operators": operators,
        "vary": listed(vary),
        "scenes": scenes,
        "pool": pool,
        "packs": opened(pack) or None,
        "store": store,
        "workers": workers,
        "executor": executor,
        "address": address,
    }
    flags: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    if resume:
        plan = resume_run(flags)
    else:
        plan = plan_of(RunConfig(**flags, command=shlex.join(["vlafuzz", *sys.argv[1:]])))
        note_defaults(plan, flags)
    with Bar() as bar:
        plan, speed = checked_plan(plan, unchecked=unchecked, watch=bar)
    certifying = looks_for_causes(plan.strategy) if certify is None else certify
    search = until.after(SEARCH) if triage or certifying else until
    forecast = Forecast(plan, speed, certifying, search, until) if speed else None
    if forecast and not triage:
        forecast = forecast.best()
    summary = _start(plan, forecast, forecast.search if forecast else search)
    beside, effects = after_run.beside_random(summary), after_run.effects(summary)
    then = after_run.again(summary)
    if not json:
        found = after_run.causes(summary)
        print_summary(summary, beside, about(plan.strategy), found.probability if found else None)
        after_run.print_again(then)
        after_run.print_effects(effects)
    allowance = Allowance(deadline=until)
    triaged: dict[str, Any] | None = {}
    if triage or certifying:
        triaged = after_run.triage_run(plan, summary, allowance, forecast, everything=triage, show=not json)
    found = after_run.causes(summary)
    if json:
        more = {"about": about(plan.strategy)} | ({"triage": triaged} if triage else {})
        print_json(after_run.document(summary, beside, effects, found, then) | more)
    else:
        after_run.print_causes(summary, found, hint=not triage)
    if not triage and (triaged is None or allowance.used_up):
        after_run.hint_at_rest(plan, found)
    if triaged is None:
        raise typer.Exit(INTERRUPTED)
    _end(plan, summary, fail_on_finding)


def note_defaults(plan: Plan, flags: Mapping[str, Any]) -> None:
    """Say which defaults follow from this machine, where the user would want to know."""
    from vlafuzz.execute.capacity import most_workers
    from vlafuzz.renderer import probe_once
    from vlafuzz.rigs.robots import PANDA

    if "policy" not in flags and plan.manifest.robot == PANDA.robot and not probe_once().works:
        hint = "`vlafuzz doctor` says what to install"
        Bar.note(f"note: nothing here draws pictures, so the policy is {plan.manifest.policy}; {hint}")
    used, batch = plan.place.workers, plan.manifest.batch
    if "workers" not in flags and plan.place.kind == "processes" and used == batch < most_workers():
        room = most_workers()
        Bar.note(
            f"note: {batch} scenes at a time keep {used} of {room} cores busy; --batch {room} is faster, and "
            "chooses them by less of what came before"
        )


def _end(plan: Plan, summary: Summary, fail_on_finding: bool) -> None:
    """Say whether the run ended early, with the exit code of its result."""
    if summary.stopped:
        Bar.note(f"stopped: {summary.stopped}")
    if summary.unjudged and not summary.verdicts["error"]:
        raise UsageError(summary.unjudged, hint=_why_not(summary))
    if summary.short:
        again = f"then `{_again(plan)}` goes on" if summary.stopped else "the same command tries them again"
        doctor = shlex.join(["vlafuzz", "doctor", "--policy", summary.policy])
        raise PrerequisiteError(summary.short, hint=f"`{doctor}` says what is wrong; {again}")
    if fail_on_finding and summary.findings:
        raise typer.Exit(1)


def _why_not(summary: Summary) -> str:
    if not summary.proposals:
        return "give it more --time"
    checks = ", ".join(f"{check} {count}" for check, count in summary.invalid.items())
    export = shlex.join(["vlafuzz", "export", summary.store, "--verdict", "all", "--out", "F.jsonl"])
    return f"no scene is fair ({checks}): `{export}` writes them, `vlafuzz lint -v F.jsonl` says why"


def _start(plan: Plan, forecast: Forecast | None, until: Deadline) -> Summary:
    from vlafuzz.campaign.forecast import NOBODY_WAITS
    from vlafuzz.campaign.launch import start
    from vlafuzz.cli.summary import RunBar

    again = _again(plan)

    def note() -> str:
        if not _is_begun(plan):
            return "interrupted: nothing is stored yet"
        return f"interrupted: all trials so far are stored in {plan.store}\nhint: continue with `{again}`"

    if forecast and forecast.run > NOBODY_WAITS:
        Bar.note(str(forecast))
    with interruptible(note), RunBar(plan.manifest.budget, forecast, until) as bar:
        try:
            return start(plan, bar, until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


def _again(plan: Plan) -> str:
    """The command that resumes a run."""
    trust = trust_flag(plan.manifest.policy, plan.manifest.strategy)
    return shlex.join(["vlafuzz", "run", "--resume", "--store", str(plan.store), *trust])


def _is_begun(plan: Plan) -> bool:
    """Whether the store has a run that can be resumed."""
    from vlafuzz.errors import StoreError
    from vlafuzz.store.records import UNFINISHED
    from vlafuzz.store.store import Store

    try:
        with Store.open(plan.store) as store:
            return any(run.status in UNFINISHED for run in store.runs())
    except StoreError:
        return False
