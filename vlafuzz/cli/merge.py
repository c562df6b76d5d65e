"""``vlafuzz merge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.output import stderr
from vlafuzz.errors import UsageError


def command(
    stores: Annotated[list[Path], typer.Argument(help="Stores that `vlafuzz run` wrote.")],
    out: Annotated[Path, typer.Option(help="The new store; must not exist yet.")],
) -> None:
    """Merge all runs, trials and findings of several stores into a new one.

    Runs are renumbered in the given order. A scene that fails for one policy in several stores is one
    finding. A run that is in two of the stores appears twice in the new one.
    """
    from vlafuzz.store.merge import merge

    twice = next((store for number, store in enumerate(stores) if store in stores[:number]), None)
    if twice is not None:
        raise UsageError(f"{twice}: given twice", hint="give each store once")
    merged = merge(stores, out)
    stderr().print(
        f"{merged.runs} runs, {merged.trials} trials and {merged.findings} findings written to {out}",
        soft_wrap=True,
    )
