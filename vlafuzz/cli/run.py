"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

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
from vlafuzz.cli.one_run import Asked, end, note_defaults, run_plan
from vlafuzz.cli.output import Bar, print_json


def command(
    task: Annotated[
        str | None,
        typer.Option(
            help="What the robot is told to do; several with commas, or all: one after another.",
            show_default="pick-up",
        ),
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
    budget: Annotated[
        int | None, typer.Option(help="Policy rollouts, for each task.", show_default="100")
    ] = None,
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

    Runs are kept in a store, by default runs/<task>-<policy>-<seed>.db; several tasks share one. Scenes that
    a store knows are answered from it at no cost. A policy of your own is first checked, for seconds: a blind
    policy, for example, is not run. With --time, half of it is for the run and what is left is for triage, if
    any; all of it is for the run where what is left would probably certify nothing. Several tasks share it.
    """
    from vlafuzz.common.deadline import deadline

    until = deadline("--time", time)
    begin_early(policy, workers, executor)
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.campaign.config import plan as plan_of
    from vlafuzz.campaign.resume import resume as resume_run
    from vlafuzz.cli.several import run_tasks
    from vlafuzz.cli.standings import print_several
    from vlafuzz.doctor.before_run import checked_plan
    from vlafuzz.worlds import task_of, tasks_named

    named = task_of(world, task)
    tasks = tasks_named(named) if named else ()
    values = {
        "task": named,
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
    asked = Asked(certify=certify, triage=triage, json=json)
    if len(tasks) > 1:
        runs, path, left = run_tasks(tasks, flags, asked, until, resume=resume, unchecked=unchecked)
        print_several(runs, path, json=json)
        end(runs, left, fail_on_finding=fail_on_finding)
        return
    if resume:
        plan = resume_run(flags)
    else:
        plan = plan_of(RunConfig(**flags, command=shlex.join(["vlafuzz", *sys.argv[1:]])))
        note_defaults(plan, flags)
    with Bar() as bar:
        plan, speed = checked_plan(plan, unchecked=unchecked, watch=bar)
    done = run_plan(plan, speed, until, asked)
    if json:
        print_json(done.document)
    end([done], fail_on_finding=fail_on_finding)
