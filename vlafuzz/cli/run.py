"""``vlafuzz run``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.output import print_json, stderr
from vlafuzz.errors import VlafuzzError


def command(
    task: Annotated[
        str | None, typer.Option(help="What the robot is told to do.", show_default="pick-up")
    ] = None,
    subject: Annotated[
        str, typer.Option(help="The policy under test, or python:pkg.mod:factory.")
    ] = "pinhole",
    strategy: Annotated[
        str | None,
        typer.Option(help="What proposes scenes, or python:pkg.mod:factory.", show_default="random"),
    ] = None,
    budget: Annotated[int | None, typer.Option(help="Subject rollouts.", show_default="100")] = None,
    seed: Annotated[int, typer.Option(help="The same seed gives the same scenes.")] = 0,
    operators: Annotated[
        str | None,
        typer.Option(help="YAML file of ranges, or a shipped one's name.", show_default="tabletop"),
    ] = None,
    vary: Annotated[
        str | None, typer.Option(help="Only these operators vary: light,camera-position,…")
    ] = None,
    scenes: Annotated[
        Path | None, typer.Option(help="Run the scenes of this file, each of them once.")
    ] = None,
    store: Annotated[
        Path | None,
        typer.Option(help="Where to keep it; an existing store gets one run more.", show_default="runs/….db"),
    ] = None,
    batch: Annotated[int, typer.Option(help="Proposals asked for at once.")] = 16,
    repeats: Annotated[int, typer.Option(help="Rollouts a scene; it fails when one of them does.")] = 1,
    stop_early: Annotated[
        bool, typer.Option("--stop-early", help="End a rollout at its first success.")
    ] = False,
    criteria: Annotated[str, typer.Option(help="What success means: strict, or published.")] = "strict",
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    fail_on_finding: Annotated[
        bool, typer.Option("--fail-on-finding", help="Exit with 1 when scenes fail.")
    ] = False,
) -> None:
    """Fuzz a subject: find scenes in which it fails.

    Runs are kept in a store, by default runs/<task>-<subject>-<strategy>-<seed>.db. Scenes that a store knows
    are answered from it and cost no budget.
    """
    from vlafuzz.cli.summary import Watch, print_summary
    from vlafuzz.config import RunConfig, plan, start

    prepared = plan(
        RunConfig(
            task=task,
            subject=subject,
            strategy=strategy,
            budget=budget,
            seed=seed,
            batch=batch,
            repeats=repeats,
            stop_early=stop_early,
            criteria=criteria,
            operators=operators,
            vary=tuple(name.strip() for name in vary.split(",")) if vary is not None else (),
            scenes=scenes,
            store=store,
            command=shlex.join(["vlafuzz", *sys.argv[1:]]),
        )
    )
    with Watch(prepared.manifest.budget) as watch:
        try:
            summary = start(prepared, watch)
        except KeyboardInterrupt:
            watch.stop()
            stderr().print(
                f"interrupted: {watch.rollouts} rollouts are stored in {prepared.store}", soft_wrap=True
            )
            raise typer.Exit(130) from None
    if json:
        print_json(asdict(summary))
    else:
        print_summary(summary)
    if summary.stopped:
        stderr().print(f"stopped: {summary.stopped}", soft_wrap=True)
    if not summary.verdicts["passed"] + summary.verdicts["failed"]:
        raise VlafuzzError("no scene could be judged", hint="`vlafuzz doctor` checks this machine")
    if fail_on_finding and summary.findings:
        raise typer.Exit(1)
