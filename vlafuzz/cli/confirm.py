"""``vlafuzz confirm``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, TrustFlag, option
from vlafuzz.cli.output import interruptible, print_json, print_lines, print_list

UNFIT = 4  # exit code where the policy does not work in the other world, so that its failures there say nothing


def command(
    source: Annotated[Path, typer.Argument(help="A store that `vlafuzz triage` worked on, or a corpus.")],
    world: Annotated[str, option("The other world, which has the same tasks.", "none")],
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Say which certified causes hold in another world too, and which are the first simulator's own.

    First the policy is rolled out in nominal scenes there: below 70 % success causes are not compared (exit code 4).
    Then it is, jittered, in the scene of each cause and in its passing neighbours, as certification does: a cause holds
    if it is shown to fail more often, most likely by 20 points; it does not where that has become improbable.
    """
    from vlafuzz.failures.causes import counted
    from vlafuzz.failures.confirmation import confirm

    with interruptible("interrupted: nothing is stored") as bar:
        result = confirm(source, world, bar)
    if json:
        print_json(asdict(result))
    else:
        items = []
        for one in result.causes:
            here, there = (
                f"fails {', without it '.join(counted(rate) if rate else 'unknown' for rate in rates)}"
                for rates in (one.found, one.other)
            )
            why = f" ({one.why})" if one.why else ""
            small = f"where it was found: {here} · {one.task} · {one.scene[:12]}"
            items.append((one.cause, f"{one.verdict} in {world}{why}: {there}", small))
        print_list(items, title=f"Causes of {source} in {world}")
        print_lines(result.says)
    if result.unfit:
        raise typer.Exit(UNFIT)
