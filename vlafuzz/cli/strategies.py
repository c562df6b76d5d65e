"""``vlafuzz strategies``."""

from __future__ import annotations

import inspect
from typing import Annotated

import typer

from vlafuzz.cli.output import print_rows


def command(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the strategies that propose scenes."""
    from vlafuzz.search.registry import STRATEGIES

    rows = [{"strategy": name, "is": _says(strategy)} for name, strategy in STRATEGIES.items()]
    print_rows(rows, json=json, csv=csv, title="strategies")


def _says(strategy: object) -> str:
    """The first paragraph of its docstring, in one line."""
    return " ".join((inspect.getdoc(strategy) or "").partition("\n\n")[0].split())
