"""``vlafuzz compare``."""

from __future__ import annotations

import json as json_format
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import AddressFlag, ExecutorFlag, OperatorsFlag, VaryFlag
from vlafuzz.cli.output import print_json, print_rows, stderr
from vlafuzz.errors import UsageError

if TYPE_CHECKING:
    from vlafuzz.cli.comparing import Sizes
    from vlafuzz.compare.compare import Comparison


def command(
    strategies: Annotated[
        str, typer.Option(help="What to compare, with commas; the others are set against the first.")
    ] = "random,nsga2,feedback",
    task: Annotated[str, typer.Option(help="What the robot is told to do.")] = "pick-up",
    policy: Annotated[
        str | None,
        typer.Option(
            help="The policy under test, or python:pkg.mod:factory.",
            show_default="mini, or pinhole where nothing renders",
        ),
    ] = None,
    budget: Annotated[int, typer.Option(help="Policy rollouts of every run.")] = 100,
    repeats: Annotated[int, typer.Option(help="Runs of every strategy.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the first run of every strategy; the others count on.")] = 0,
    operators: OperatorsFlag = None,
    vary: VaryFlag = None,
    workers: Annotated[int, typer.Option(help="Processes that evaluate scenes.")] = 1,
    executor: ExecutorFlag = None,
    address: AddressFlag = None,
    solvable: Annotated[
        int, typer.Option(help="Failures of every strategy that the expert tries to solve.")
    ] = 50,
    triage_sample: Annotated[
        int, typer.Option(help="Of these, failures of every strategy that are triaged: ~50 rollouts each.")
    ] = 0,
    store: Annotated[
        Path | None, typer.Option(help="Where to keep all runs.", show_default="runs/compare-….db")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for page, plots and tables.", show_default="runs/compare-…")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV, a row a strategy.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print markdown.")] = False,
) -> None:
    """Compare strategies: several runs of each with the same seeds and the same budget of rollouts.

    No run learns from another one's rollouts. All are kept in one store; the same command goes on where it
    was interrupted, and with more --repeats, --strategies or --triage-sample it does what is missing.
    """
    from vlafuzz.campaign import config
    from vlafuzz.cli.comparing import Sizes, compare

    names, sizes = _names(strategies), Sizes(solvable, triage_sample)
    _check(names, repeats, seed, sizes, sum((json, csv, markdown)))
    name = f"compare-{config.default_store(task, policy or config.default_policy(), '', 0).stem[:-3]}"
    where = store or Path("runs") / f"{name}.db"
    asked = config.RunConfig(
        task=task,
        policy=policy or config.default_policy(),
        strategy=names[0],
        budget=budget,
        seed=seed,
        operators=operators,
        vary=tuple(each.strip() for each in vary.split(",")) if vary is not None else (),
        store=where,
        workers=workers,
        executor=executor,
        address=address,
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    folder = out or (where.with_suffix("") if where.suffix else where.with_name(f"{where.name}-compare"))
    try:
        compared = compare(asked, names, repeats, sizes, folder)
    except KeyboardInterrupt:
        stderr().print(
            f"interrupted: all that is done is stored in {where}\nhint: the same command goes on",
            soft_wrap=True,
        )
        raise typer.Exit(130) from None
    try:
        _write(compared, folder)
    except OSError as error:
        raise UsageError(f"--out: {error}", hint="what was run is stored: the same command goes on") from None
    _print(compared, json=json, csv=csv, markdown=markdown)


def _names(strategies: str) -> list[str]:
    names = [name.strip() for name in strategies.split(",") if name.strip()]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise UsageError(f"--strategies: {twice[0]!r} is there twice", hint="name each of them once")
    if not names:
        raise UsageError(f"--strategies: expected names, got {strategies!r}", hint="random,nsga2")
    return names


def _check(names: list[str], repeats: int, seed: int, sizes: Sizes, formats: int) -> None:
    """What can be known to be wrong before anything is planned."""
    from vlafuzz.campaign import config
    from vlafuzz.search.registry import strategy_factory

    for flag, value, least in (
        ("--repeats", repeats, 1),
        ("--solvable", sizes.tried, 0),
        ("--triage-sample", sizes.triaged, 0),
    ):
        if value < least:
            hint = f"give {flag} {least} or more"
            raise UsageError(f"{flag}: expected at least {least}, got {value}", hint=hint)
    if sizes.triaged > sizes.tried:
        told = f"--triage-sample: {sizes.triaged} of the {sizes.tried} failures of --solvable"
        raise UsageError(told, hint=f"give --solvable {sizes.triaged} or more")
    if seed + repeats - 1 > config.MOST:
        raise UsageError(f"--seed: too large for {repeats} repeats, got {seed}", hint="give a smaller one")
    if formats > 1:
        raise UsageError("--json, --csv and --markdown exclude each other", hint="give one of them")
    for name in names:
        strategy_factory(name)


def _write(compared: Comparison, folder: Path) -> None:
    from vlafuzz.cli import compared as shown
    from vlafuzz.cli.compared_page import page
    from vlafuzz.compare.plots import plot
    from vlafuzz.report.page import write_page

    told = json_format.dumps(asdict(compared), indent=2, allow_nan=False)
    (folder / "compare.json").write_text(told + "\n", encoding="utf-8")
    (folder / "compare.md").write_text(shown.markdown(compared), encoding="utf-8")
    shown.write_runs(compared, folder / "runs.csv")
    plots = plot(compared, folder)
    write_page(folder / "compare.html", page(compared, {path.name: path.read_bytes() for path in plots}))
    names = ["compare.html", *(path.name for path in plots), "compare.json", "compare.md", "runs.csv"]
    stderr().print(f"written to {folder}: {', '.join(names)}", soft_wrap=True)


def _print(compared: Comparison, *, json: bool, csv: bool, markdown: bool) -> None:
    from vlafuzz.cli import compared as shown

    if json:
        print_json(asdict(compared))
    elif csv:
        print_rows(shown.csv_rows(compared), csv=True)
    elif markdown:
        sys.stdout.write(shown.markdown(compared))
    else:
        shown.print_comparison(compared)
