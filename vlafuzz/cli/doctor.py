"""``vlafuzz doctor``."""

from collections.abc import Iterator
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import JsonFlag, configured, option, with_run_options
from vlafuzz.cli.output import Bar, data, print_lines, print_rows
from vlafuzz.common.check import Check
from vlafuzz.doctor.machine import machine
from vlafuzz.errors import UsageError, check_number


@with_run_options(
    *("policy", "task", "robot", "operators", "packs", "seed"),
    policy="none: check this machine",
    task="the first: `vlafuzz list worlds`",
    robot="the world's first",
)
def doctor(
    *,
    world: Annotated[
        str | None,
        option("The policy's world; without a policy, one of your own, python:pkg.mod:factory, to be checked itself."),
    ] = None,
    n: Annotated[int | None, option("Nominal scenes that the policy is to solve.", "10", flag="--n")] = None,
    json: JsonFlag = False,
    **given: Any,
) -> None:
    """Check this machine, a policy or a world: what is there, whether it works, and what follows from it.

    A policy is checked in the simulator: whether it sees, hears, repeats itself and can do the task; where it fails,
    whether something is the wrong way round. A world of your own is checked for resets that repeat themselves, values
    that arrive and act, and pictures. Exit code 3: something must be fixed first.
    """
    flags = configured(given)
    policy, task = flags.get("policy"), flags.get("task")
    done, interrupted = list[Check](), False
    asked = flags | {"n": n, "task": None if world else task}
    if policy is None and (names := [name for name, value in asked.items() if value is not None]):
        raise UsageError(f"--{names[0].replace('packs', 'pack')} needs --policy", hint="name the policy to be checked")
    with Bar() as bar:
        if policy is None and world is not None:
            checks = _checks_of(world, task)
        elif policy is None:
            checks = machine()
        else:
            check_number("--n", n, 1, 1000)
            from vlafuzz.campaign.config import RunConfig
            from vlafuzz.doctor.exam import examine
            from vlafuzz.worlds import task_of

            run = RunConfig(**flags | {"task": task_of(world, task)})
            checks = examine(run, 10 if n is None else n, bar)
        try:
            bar.progress("checks", 0, None)
            for check in checks:
                done.append(check)
                if not json:  # at once: with a slow policy the next one may take many minutes
                    bar.clear()
                    print_lines(f"{check.verdict}: {check.check}: {'; '.join(filter(None, check[1::2]))}")
                    data().flush()
                bar.progress("checks", len(done), None)
        except KeyboardInterrupt:
            interrupted = True
    if json and done:
        print_rows([check._asdict() for check in done], json=True)
    if interrupted:
        raise typer.Abort
    if any(check.verdict == "refuse" for check in done):
        raise typer.Exit(3)


def _checks_of(world: str, task: str | None) -> Iterator[Check]:
    """The checks of a world of the user's own, in the task that is named, or in its first."""
    from vlafuzz.common.plugins import trust
    from vlafuzz.worlds import parted, world_named
    from vlafuzz.worlds.first_use import remember
    from vlafuzz.worlds.soundness import examine
    from vlafuzz.worlds.values import ValuesWorld

    name, named = parted(world)
    trust(name)
    made = world_named(name)
    wanted = task or named or next(iter(made.tasks))
    made.task(wanted)
    sound = True
    for check in examine(made, wanted, name):
        sound = sound and check.verdict != "refuse"
        yield check
    if sound and isinstance(made, ValuesWorld):
        remember(name, made, wanted)
