"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.early import begin_early
from vlafuzz.cli.flags import (
    AddressFlag,
    ExecutorFlag,
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
from vlafuzz.cli.output import INTERRUPTED, Bar, interruptible, print_json, stdout
from vlafuzz.errors import PolicyError, VlafuzzError
from vlafuzz.plugins import trust_flag
from vlafuzz.text import duration, plural

if TYPE_CHECKING:
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.forecast import Forecast
    from vlafuzz.campaign.results import Beside
    from vlafuzz.campaign.tally import Summary
    from vlafuzz.deadline import Deadline
    from vlafuzz.report.causes import CauseList
    from vlafuzz.triage.pipeline import Allowance

# The keys of ``CauseList.document`` for a strategy that does not look for causes.
_NO_CAUSES = dict.fromkeys(("causes", "unexplained", "probability", "certification"))


def command(
    task: Annotated[
        str | None, typer.Option(help="What the robot is told to do.", show_default="pick-up")
    ] = None,
    robot: RobotFlag = None,
    policy: PolicyFlag = None,
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
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    fail_on_finding: Annotated[
        bool, typer.Option("--fail-on-finding", help="Exit with 1 when scenes fail.")
    ] = False,
) -> None:
    """Fuzz a policy: find scenes in which it fails, and with strategy causes why.

    Runs are kept in a store, by default runs/<task>-<policy>-<strategy>-<seed>.db. Scenes that a store knows
    are answered from it at no cost. A policy of your own is first checked, for seconds: a blind policy,
    for example, is not run. With --time, half of it is for the run and what is left is for triage, if any.
    """
    from vlafuzz.deadline import deadline

    until = deadline("--time", time)
    begin_early(policy, workers, executor)
    from vlafuzz.campaign import config
    from vlafuzz.campaign.forecast import NOBODY_WAITS, Forecast
    from vlafuzz.campaign.launch import SEARCH
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.summary import print_summary
    from vlafuzz.cli.triage import print_causes
    from vlafuzz.diagnostics.before_run import checked_plan
    from vlafuzz.search.base import about, looks_for_causes
    from vlafuzz.triage.pipeline import Allowance

    values = {
        "task": task,
        "robot": robot,
        "policy": policy,
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
        plan = config.plan(config.RunConfig(**flags, command=shlex.join(["vlafuzz", *sys.argv[1:]])))
    with Bar() as bar:
        plan, speed = checked_plan(plan, unchecked=unchecked, watch=bar)
    certifying = looks_for_causes(plan.strategy) if certify is None else certify
    forecast = Forecast(plan, speed, certifying) if speed else None
    if forecast and forecast.run > NOBODY_WAITS:
        Bar.note(str(forecast))
    summary = _start(plan, forecast, until.after(SEARCH) if triage or certifying else until)
    found, beside, strategy_about = _causes(summary), _beside_random(summary), about(plan.strategy)
    if not json:
        print_summary(summary, beside, strategy_about, found.probability if found else None)
    allowance = Allowance(deadline=until)
    triaged: dict[str, Any] | None = {}
    if triage or certifying:
        triaged = _triage(plan, summary, allowance, everything=triage, show=not json)
    found = _causes(summary)
    if json:
        document = asdict(summary) | {"about": strategy_about, "random": asdict(beside) if beside else None}
        document |= found.document() if found else _NO_CAUSES
        print_json(document | ({"triage": triaged} if triage else {}))
    elif found:
        print_causes(found)
    elif not triage:
        _hint_at_triage(summary, plan.manifest.policy)
    if not triage and (triaged is None or allowance.used_up):
        _hint_at_rest(plan, found)
    if triaged is None:
        raise typer.Exit(INTERRUPTED)
    _end(summary, fail_on_finding)


def _hint_at_triage(summary: Summary, policy: str) -> None:
    if summary.findings:
        command = shlex.join(["vlafuzz", "triage", summary.store, *trust_flag(policy)])
        failures = plural(summary.findings, "failure")
        stdout().print(f"{failures}; `{command}` finds their causes", soft_wrap=True)


def _end(summary: Summary, fail_on_finding: bool) -> None:
    """Say whether the run ended early, with the exit code of its result."""
    if summary.stopped:
        Bar.note(f"stopped: {summary.stopped}")
    if not summary.verdicts["passed"] + summary.verdicts["failed"]:
        raise VlafuzzError("no scene could be judged", hint=_why_not(summary))
    if fail_on_finding and summary.findings:
        raise typer.Exit(1)


def _hint_at_rest(plan: Plan, found: CauseList | None) -> None:
    """How to certify as many causes as are missing after an interruption, or when the time is over."""
    from vlafuzz.triage.pipeline import affordable

    missing = min(found.found, affordable(plan.manifest.budget)) - found.certified if found else 0
    if missing > 0:
        trust = trust_flag(plan.manifest.policy)
        command = shlex.join(["vlafuzz", "triage", str(plan.store), "--limit", str(missing), *trust])
        Bar.note(f"hint: continue with `{command}`")


def _why_not(summary: Summary) -> str:
    if not summary.proposals:
        return "give it more --time"
    if summary.verdicts["error"] or not summary.invalid:
        return "`vlafuzz doctor` checks this machine"
    checks = ", ".join(f"{check} {count}" for check, count in summary.invalid.items())
    export = shlex.join(["vlafuzz", "export", summary.store, "--verdict", "all", "--out", "F.jsonl"])
    return f"no scene is fair ({checks}): `{export}` writes them, `vlafuzz lint -v F.jsonl` says why"


def _start(plan: Plan, forecast: Forecast | None, until: Deadline) -> Summary:
    from vlafuzz.campaign.launch import start
    from vlafuzz.cli.summary import RunBar

    trust = trust_flag(plan.manifest.policy, plan.manifest.strategy)
    again = shlex.join(["vlafuzz", "run", "--resume", "--store", str(plan.store), *trust])
    stored = f"interrupted: all trials so far are stored in {plan.store}\nhint: continue with `{again}`"
    with interruptible(stored), RunBar(plan.manifest.budget, forecast) as bar:
        try:
            return start(plan, bar, until)
        except PolicyError as error:
            hint = f"when the policy is back, continue with `{again}`"
            raise PolicyError(error.message, hint=hint) from error


def _triage(
    plan: Plan, summary: Summary, allowance: Allowance, *, everything: bool, show: bool
) -> dict[str, Any] | None:
    """Triage all findings of the store, or only those that show causes of the run; None if interrupted."""
    from vlafuzz.cli.triage import triage_store
    from vlafuzz.store.store import Store
    from vlafuzz.triage.pipeline import PER_CAUSE, affordable, expected

    found = None if everything else _causes(summary)
    if found and found.found:
        most = affordable(plan.manifest.budget)
        some = f"the {'' if most == 1 else f'{most} '}commonest of " if most < found.found else ""
        count = plural(found.found, "cause")
        with Store.open(Path(summary.store)) as store:
            takes = duration(expected(store, min(most, found.found), plan.triage_workers))
        each = f"{PER_CAUSE} rollouts or more each, about {takes}"
        Bar.note(f"certifying {some}{count}, {each}; --no-certify leaves this out")
    try:
        return triage_store(
            Path(summary.store),
            workers=plan.triage_workers,
            allowance=allowance,
            causes_of=None if everything else summary.run,
            show=everything and show,
        )
    except typer.Exit:  # the causes so far are shown all the same
        return None


def _causes(summary: Summary) -> CauseList | None:
    from vlafuzz.report.causes import causes_of
    from vlafuzz.store.store import Store

    with Store.open(Path(summary.store)) as store:
        return next(causes_of(store, run) for run in store.runs() if run.id == summary.run)


def _beside_random(summary: Summary) -> Beside | None:
    """A guided run beside random generation; None where there is nothing to compare."""
    from vlafuzz.campaign.results import beside_random
    from vlafuzz.search.base import UNGUIDED
    from vlafuzz.store.store import Store

    if summary.strategy in UNGUIDED:
        return None
    with Store.open(Path(summary.store)) as store:
        return beside_random(store, summary.run)
