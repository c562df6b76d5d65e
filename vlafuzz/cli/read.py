"""``vlafuzz read``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import JsonFlag
from vlafuzz.cli.output import print_json, print_rows
from vlafuzz.common.text import Row

if TYPE_CHECKING:
    from vlafuzz.logs.episodes import SuccessRate

_MOST = 5  # tasks in a table: those that fail most often


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(help="lerobot's eval_info.json, vla-eval's results or CSV; several are one evaluation."),
    ],
    json: JsonFlag = False,
) -> None:
    """Read the logs of an evaluation that you already run: success rates by suite, condition and task.

    Rates come with 95 % intervals. Nothing is rolled out.
    """
    from vlafuzz.logs.episodes import rates
    from vlafuzz.logs.formats import read_logs

    found = rates(read_logs(logs))
    name = str(logs[0]) if len(logs) == 1 else f"{logs[0]} and {len(logs) - 1} more"
    if json:
        print_json({"log": name, "rates": list(map(asdict, found))})
        return
    tasks = sorted((rate for rate in found if rate.task), key=lambda rate: rate.success.share)
    some = f"The {_MOST} of {len(tasks)} tasks that fail most" if len(tasks) > _MOST else "Tasks"
    _print(name, [rate for rate in found if not (rate.condition or rate.task)], "suite")
    _print("Conditions", [rate for rate in found if rate.condition], "condition")
    _print(some, tasks[:_MOST], "suite", "task")


def _print(title: str, rates: Sequence[SuccessRate], *names: str) -> None:
    rows: list[Row] = [
        {name: getattr(rate, name) or "all" for name in names}
        | {"episodes": rate.success.of, "success": str(rate.success), "failed": rate.success.of - rate.success.count}
        | ({"errors": rate.errors} if any(one.errors for one in rates) else {})
        for rate in rates
    ]
    if rows:
        print_rows(rows, title=title)
