"""``vlafuzz read``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import AlphaFlag, JsonFlag, option
from vlafuzz.cli.output import print_json, print_lines, print_rows
from vlafuzz.common.text import Row, percent, plural, points
from vlafuzz.errors import PrerequisiteError, check_probability

if TYPE_CHECKING:
    from vlafuzz.logs.against import LogComparison
    from vlafuzz.logs.episodes import SuccessRate

_MOST = 5  # tasks in a table: those that fail most often


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(help="lerobot's eval_info.json, vla-eval's results or CSV; several are one evaluation."),
    ],
    against: Annotated[list[Path] | None, option("Compare with this log, the older one; may be repeated.")] = None,
    alpha: AlphaFlag = 0.05,
    json: JsonFlag = False,
) -> None:
    """Read the logs of an evaluation that you already run: success rates, and two logs compared.

    Rates come with 95 % intervals, by suite, condition and task. With --against, the exit code is 1 if a suite, or all
    of them together, got worse, and 3 if the logs cannot tell. Nothing is rolled out.
    """
    check_probability("--alpha", alpha)
    from vlafuzz.logs.against import compare
    from vlafuzz.logs.episodes import rates
    from vlafuzz.logs.formats import read_logs

    episodes, name = read_logs(logs), _name(logs)
    found = rates(episodes)
    compared = compare(read_logs(against), episodes, (_name(against), name), alpha) if against else None
    if json:
        told = {one: getattr(compared, one) for one in ("verdict", "tells", "worse", "better")} if compared else {}
        print_json({"log": name, "rates": list(map(asdict, found)), "against": compared and asdict(compared) | told})
    else:
        tasks = sorted((rate for rate in found if rate.task), key=lambda rate: rate.success.share)
        some = f"The {_MOST} of {len(tasks)} tasks that fail most" if len(tasks) > _MOST else "Tasks"
        of_suites = [rate for rate in found if not (rate.condition or rate.task)]
        _print(name, of_suites, "suite")
        _print("Conditions", [rate for rate in found if rate.condition], "condition")
        _print(some, tasks[:_MOST], "suite", "task")
        if compared:
            _print_comparison(compared)
    if compared and compared.worse:  # exit codes as of `regress`
        raise typer.Exit(1)
    if compared and not compared.tells:
        raise PrerequisiteError(compared.verdict, hint="compare logs with more episodes of the same suites")


def _name(paths: list[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"


def _print(title: str, rates: Sequence[SuccessRate], *names: str) -> None:
    rows: list[Row] = [
        {name: getattr(rate, name) or "all" for name in names}
        | {"episodes": rate.success.of, "success": str(rate.success), "failed": rate.success.of - rate.success.count}
        | ({"errors": rate.errors} if any(one.errors for one in rates) else {})
        for rate in rates
    ]
    if rows:
        print_rows(rows, title=title)


def _print_comparison(compared: LogComparison) -> None:
    rows = [
        {
            "suite": one.suite,
            "episodes": f"{one.new.of} paired" if one.paired else f"{one.old.of}, {one.new.of}",
            "old": percent(one.old.share),
            "new": percent(one.new.share),
            "points": f"{points(one.gain)} ({' to '.join(map(points, one.difference))})",
            "lost, won": f"{one.worse}, {one.better}" if one.paired else "–",
            "p": f"{one.p_holm:.2g}",
        }
        for one in compared.contrasts
    ]
    if rows:
        print_rows(rows, title=f"{compared.new} against {compared.old}")
    print_lines(f"{compared.verdict}.")
    if rows:
        print_lines(
            "Points: new minus old, with 95% intervals; lost, won: episodes in which only the old or the new "
            "one succeeds; p: corrected for all rows (Holm)."
        )
    if rows and (left := compared.contrasts[-1].left):
        print_lines(f"Not compared: {plural(left, 'episode')} without a partner.")
    if compared.missing:
        print_lines(f"In one of the logs only: {', '.join(compared.missing)}.")
