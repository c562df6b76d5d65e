"""``vlafuzz read``."""

from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import AlphaFlag, JsonFlag, MarkdownFlag, option
from vlafuzz.cli.output import data, print_json, print_lines, print_rows
from vlafuzz.errors import PrerequisiteError, UsageError, check_probability, printable, suggestion


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(help="lerobot's eval_info.json, vla-eval's results or CSV; several are one evaluation."),
    ],
    against: Annotated[list[Path] | None, option("Compare with this log, the older one; may be repeated.")] = None,
    column: Annotated[
        list[str] | None, option("What a column of CSV holds, if it has another name: success=ok; may be repeated.")
    ] = None,
    alpha: AlphaFlag = 0.05,
    markdown: MarkdownFlag = False,
    json: JsonFlag = False,
) -> None:
    """Read the logs of an evaluation that you already run: success rates, and two logs compared.

    Rates come with 95 % intervals, by suite, condition and task. With --against, the exit code is 1 if a suite, or all
    of them together, got worse, and 3 if the logs cannot tell. Nothing is rolled out.
    """
    check_probability("--alpha", alpha)
    if json and markdown:
        raise UsageError("--json and --markdown exclude each other", hint="give one of them")
    from vlafuzz.logs import show
    from vlafuzz.logs.against import compare
    from vlafuzz.logs.episodes import rates
    from vlafuzz.logs.formats import read_logs

    columns = _columns(column or [])
    episodes = read_logs(logs, columns)
    compared = None
    if against:
        compared = compare(read_logs(against, columns), episodes, (_name(against), _name(logs)), alpha)
    reading = show.Reading(name=_name(logs), rates=tuple(rates(episodes)), against=compared)
    if json:
        print_json(show.document(reading))
    elif markdown:
        data().write(printable(show.markdown(reading)))
    else:
        for title, rows in show.tables(reading).items():
            print_rows(rows, title=title)
        print_lines(*show.sentences(reading))
    if compared and compared.worse:  # exit codes as of `regress`
        raise typer.Exit(1)
    if compared and not compared.tells:
        raise PrerequisiteError(compared.verdict, hint="compare logs with more episodes of the same suites")


def _name(paths: list[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"


def _columns(given: list[str]) -> dict[str, str]:
    from vlafuzz.logs.formats import NAMES

    pairs = [entry.partition("=") for entry in given]
    for holds, equals, name in pairs:
        if not (equals and name):
            raise UsageError(f"--column {holds}: names no column", hint="such as --column success=ok")
        if holds not in NAMES:
            raise UsageError(f"--column {holds}={name}: unknown {holds!r}", hint=suggestion(holds, NAMES))
    return {holds: name for holds, _, name in pairs}
