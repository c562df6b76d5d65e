"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.flags import AddressFlag, ExecutorFlag, OperatorsFlag, PlacementFlag, RobotFlag, VaryFlag
from vlafuzz.cli.output import Bar, print_json, stderr
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.errors import PolicyError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.campaign.baseline import Beside
    from vlafuzz.campaign.config import Plan
    from vlafuzz.campaign.tally import Summary


def command(
    task: Annotated[
        str | None, typer.Option(help="What the robot is told to do.", show_default="pick-up")
    ] = None,
    robot: RobotFlag = None,
    policy: Annotated[
        str | None,
        typer.Option(
            help="The policy under test, or python:pkg.mod:factory.",
            show_default="mini, or pinhole where nothing renders",
        ),
    ] = None,
    strategy: Annotated[
        str | None,
        typer.Option(help="What proposes scenes, or python:pkg.mod:factory.", show_default="surrogate"),
    ] = None,
    budget: Annotated[int | None, typer.Option(help="Policy rollouts.", show_default="100")] = None,
    seed: Annotated[
        int | None, typer.Option(help="The same seed gives the same scenes.", show_default="0")
    ] = None,
    operators: OperatorsFlag = None,
    vary: VaryFlag = None,
    scenes: Annotated[
        Path | None, typer.Option(help="Run the scenes of this file, each of them once.")
    ] = None,
    pool: Annotated[
        Path | None, typer.Option(help="The strategy chooses from the scenes of this file.")
    ] = None,
    pack: PackFlag = None,
    store: Annotated[
        Path | None,
        typer.Option(help="Where to keep it; an existing store gets one run more.", show_default="runs/….db"),
    ] = None,
    batch: Annotated[int | None, typer.Option(help="Proposals asked for at once.", show_default="16")] = None,
    repeats: Annotated[
        int | None, typer.Option(help="Rollouts a scene; it fails when one of them does.", show_default="1")
    ] = None,
    stop_early: Annotated[
        bool | None, typer.Option("--stop-early", help="End a rollout at its first success.")
    ] = None,
    criteria: Annotated[
        str | None, typer.Option(help="What success means: strict, or published.", show_default="strict")
    ] = None,
    placement: PlacementFlag = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that evaluate scenes.", show_default="1")
    ] = None,
    executor: ExecutorFlag = None,
    address: AddressFlag = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with a stored run that ended early; what no flag says is taken from it."
        ),
    ] = False,
    triage: Annotated[
        bool, typer.Option("--triage", help="Triage what the store then holds, as `vlafuzz triage` does.")
    ] = False,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="Do not look first whether the policy sees, hears and moves.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    fail_on_finding: Annotated[
        bool, typer.Option("--fail-on-finding", help="Exit with 1 when scenes fail.")
    ] = False,
) -> None:
    """Fuzz a policy: find scenes in which it fails.

    Runs are kept in a store, by default runs/<task>-<policy>-<strategy>-<seed>.db. Scenes that a store knows
    are answered from it and cost no budget. A policy of your own is looked at first, for seconds: one
    that is blind, say, is not run.
    """
    from vlafuzz.campaign import config
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli import triage as triaging
    from vlafuzz.cli.summary import print_summary
    from vlafuzz.diagnostics.before_run import checked_plan
    from vlafuzz.search.base import about

    asked = {
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
        "vary": tuple(name.strip() for name in vary.split(",")) if vary is not None else None,
        "scenes": scenes,
        "pool": pool,
        "packs": opened(pack) or None,
        "store": store,
        "workers": workers,
        "executor": executor,
        "address": address,
    }
    flags: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
    if resume:
        plan = resume_run(flags)
    else:
        plan = config.plan(config.RunConfig(**flags, command=shlex.join(["vlafuzz", *sys.argv[1:]])))
    with Bar() as bar:
        plan = checked_plan(plan, unchecked=unchecked, watch=bar)
    summary = _start(plan)
    beside, said = _beside_random(summary), about(plan.strategy)
    if not json:
        print_summary(summary, beside, said)
    summarise = (
        triaging.triage_store(Path(summary.store), workers=workers or 1, show=not json) if triage else None
    )
    if json:
        found = {"about": said, "random": asdict(beside) if beside else None}
        print_json(asdict(summary) | found | ({"triage": summarise} if summarise else {}))
    if summary.stopped:
        stderr().print(f"stopped: {summary.stopped}", soft_wrap=True)
    if not summary.verdicts["passed"] + summary.verdicts["failed"]:
        raise VlafuzzError("no scene could be judged", hint=_why_not(summary))
    if fail_on_finding and summary.findings:
        raise typer.Exit(1)


def _why_not(summary: Summary) -> str:
    if summary.verdicts["error"] or not summary.invalid:
        return "`vlafuzz doctor` checks this machine"
    checks = ", ".join(f"{check} {count}" for check, count in summary.invalid.items())
    export = shlex.join(["vlafuzz", "export", summary.store, "--verdict", "all", "--out", "F.jsonl"])
    return f"no scene is fair ({checks}): `{export}` writes them, `vlafuzz lint -v F.jsonl` says why"


def _start(plan: Plan) -> Summary:
    """Run it, with a bar."""
    from vlafuzz.campaign.launch import start
    from vlafuzz.cli.summary import Watch

    again = shlex.join(["vlafuzz", "run", "--resume", "--store", str(plan.store)])
    with Watch(plan.manifest.budget) as watch:
        try:
            return start(plan, watch)
        except KeyboardInterrupt:
            watch.stop()
            told = f"interrupted: all trials so far are stored in {plan.store}"
            stderr().print(f"{told}\nhint: go on with `{again}`", soft_wrap=True)
            raise typer.Exit(130) from None
        except PolicyError as error:
            raise PolicyError(error.message, hint=f"when it is back, go on with `{again}`") from error


def _beside_random(summary: Summary) -> Beside | None:
    """A guided run beside random generation; None for what has no share of its own to compare."""
    from vlafuzz.campaign.baseline import beside_random
    from vlafuzz.store.store import Store

    if summary.strategy in ("random", "pool"):
        return None
    with Store.open(Path(summary.store)) as store:
        return beside_random(store, summary.run)
