"""``vlafuzz operators``."""

from __future__ import annotations

from typing import Annotated

import typer

from vlafuzz.cli.output import print_rows
from vlafuzz.space.operator_set import load_operators
from vlafuzz.tasks.tabletop import task as task_named


def command(
    operators: Annotated[
        str | None,
        typer.Option(help="YAML file of ranges, or a shipped one's name.", show_default="tabletop"),
    ] = None,
    task: Annotated[str | None, typer.Option(help="The ranges in this task, where they differ.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the operators and their ranges."""
    chosen = load_operators(operators)
    if task is not None:
        chosen = chosen.in_task(task_named(task).name)
    elif chosen.tasks and not (json or csv):
        typer.echo(f"ranges differ in {', '.join(sorted(chosen.tasks))}: --task shows them", err=True)
    rows = [
        {
            "operator": name,
            "changes": operator.says,
            "range": operator.ranges(),
            "nominal": operator.nominally(),
            "varies": "yes" if name in chosen.varied else "no",
        }
        for name, operator in chosen.operators.items()
    ]
    title = f"{chosen.source.stem}: {chosen.min_distance:g} m between the centres of any two objects"
    print_rows(rows, json=json, csv=csv, title=title)
