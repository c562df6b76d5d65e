"""``vlafuzz subjects``."""

from __future__ import annotations

from typing import Annotated

import typer

from vlafuzz.cli.output import print_rows


def command(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the subjects that can be tested."""
    from vlafuzz.subjects.registry import known_subjects

    rows = [{"subject": name, "is": says} for name, says in known_subjects().items()]
    print_rows(rows, json=json, csv=csv, title="subjects")
