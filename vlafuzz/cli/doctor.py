"""``vlafuzz doctor``."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Annotated

import typer

from vlafuzz.cli.flags import OperatorsFlag, PackFlag, TimeFlag, opened
from vlafuzz.cli.output import Bar, print_row, print_rows
from vlafuzz.common.deadline import Deadline, deadline
from vlafuzz.doctor import Check
from vlafuzz.doctor.machine import machine
from vlafuzz.errors import UsageError, check_number

MOST = 1000
WIDTHS = {"check": 14, "verdict": 7}  # characters; the longest is "proprioception"


def doctor(
    policy: Annotated[
        str | None, typer.Option(help="Check this policy, or python:pkg.mod:factory.", show_default="this machine")
    ] = None,
    task: Annotated[
        str | None, typer.Option(help="What the policy is told to do.", show_default="the first: `vlafuzz list worlds`")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="Whose hand it is.", show_default="the world's first")] = None,
    operators: OperatorsFlag = None,
    pack: PackFlag = None,
    seed: Annotated[int | None, typer.Option(help="The same seed gives the same scenes.", show_default="0")] = None,
    n: Annotated[
        int | None, typer.Option("--n", help="Nominal scenes that the policy is to solve.", show_default="10")
    ] = None,
    time: TimeFlag = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Check this machine, or a policy: what is there, whether it works, and what follows from it.

    A policy is checked in the simulator: whether it sees, hears, repeats itself and can do the task; where it fails,
    whether something is the wrong way round. Exit code 3: something must be fixed first.
    """
    packs = opened(pack) or None
    values = {"task": task, "robot": robot, "operators": operators, "packs": packs, "seed": seed}
    flags = {name: value for name, value in values.items() if value is not None}
    until = deadline("--time", time)
    if policy is None and (flags or n is not None or time is not None):
        raise UsageError("nothing but --json goes without --policy", hint="name the policy to be checked")
    with Bar() as bar:
        checks = machine(bar) if policy is None else _examine(policy, flags, n, bar, until)
        done, complete = _until_interrupted(checks, (lambda _: None) if json else partial(_print, bar))
    if json and done:
        print_rows([check._asdict() for check in done], json=True)
    if not complete:
        raise typer.Abort
    if any(check.verdict == "refuse" for check in done):
        raise typer.Exit(3)


def _examine(policy: str, flags: Mapping[str, object], n: int | None, bar: Bar, until: Deadline) -> Iterator[Check]:
    check_number("--n", n, 1, MOST)
    from vlafuzz.campaign.config import RunConfig
    from vlafuzz.doctor.before_run import examine

    run = RunConfig(policy=policy, **flags)  # type: ignore[arg-type]
    return examine(run, 10 if n is None else n, bar, until)


def _until_interrupted(checks: Iterator[Check], show: Callable[[list[Check]], None]) -> tuple[list[Check], bool]:
    """The checks, each shown as soon as it is known, and whether all were done."""
    done: list[Check] = []
    try:
        for check in checks:
            done += [check]
            show(done)
    except KeyboardInterrupt:
        return done, False
    return done, True


def _print(bar: Bar, done: list[Check]) -> None:
    """Print the newest check as the next row: with a slow policy the last one may take many minutes."""
    bar.clear()
    print_row(done[-1]._asdict(), WIDTHS, first=len(done) == 1)
