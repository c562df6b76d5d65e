"""``vlafuzz doctor``."""

from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, OperatorsFlag, PackFlag, TimeFlag, opened, option, option_of
from vlafuzz.cli.output import Bar, print_row, print_rows
from vlafuzz.common.deadline import deadline
from vlafuzz.doctor import Check
from vlafuzz.doctor.machine import machine
from vlafuzz.errors import UsageError, check_number

WIDTHS = {"check": 14, "verdict": 7}  # characters; the longest is "proprioception"


def doctor(
    policy: Annotated[str | None, option_of("policy", "none: check this machine")] = None,
    task: Annotated[str | None, option_of("task", "the first: `vlafuzz list worlds`")] = None,
    robot: Annotated[str | None, option_of("robot", "the world's first")] = None,
    operators: OperatorsFlag = None,
    pack: PackFlag = None,
    seed: Annotated[int | None, option_of("seed")] = None,
    n: Annotated[int | None, option("Nominal scenes that the policy is to solve.", "10", flag="--n")] = None,
    time: TimeFlag = None,
    json: JsonFlag = False,
) -> None:
    """Check this machine, or a policy: what is there, whether it works, and what follows from it.

    A policy is checked in the simulator: whether it sees, hears, repeats itself and can do the task; where it fails,
    whether something is the wrong way round. Exit code 3: something must be fixed first.
    """
    packs = opened(pack) or None
    values = {"task": task, "robot": robot, "operators": operators, "packs": packs, "seed": seed}
    flags = {name: value for name, value in values.items() if value is not None}
    until, done, interrupted = deadline("--time", time), list[Check](), False
    if policy is None and (flags or n is not None or time is not None):
        raise UsageError("nothing but --json goes without --policy", hint="name the policy to be checked")
    with Bar() as bar:
        if policy is None:
            checks = machine()
        else:
            check_number("--n", n, 1, 1000)
            from vlafuzz.campaign.config import RunConfig
            from vlafuzz.doctor.exam import examine

            run = RunConfig(policy=policy, **flags)  # type: ignore[arg-type]
            checks = examine(run, 10 if n is None else n, bar, until)
        try:
            for check in checks:
                done.append(check)
                if not json:  # at once: with a slow policy the next one may take many minutes
                    bar.clear()
                    print_row(check._asdict(), WIDTHS, first=len(done) == 1)
        except KeyboardInterrupt:
            interrupted = True
    if json and done:
        print_rows([check._asdict() for check in done], json=True)
    if interrupted:
        raise typer.Abort
    if any(check.verdict == "refuse" for check in done):
        raise typer.Exit(3)
