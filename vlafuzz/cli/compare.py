"""``vlafuzz compare``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz.cli.flags import AddressFlag, ExecutorFlag, OperatorsFlag, PolicyFlag, VaryFlag, listed
from vlafuzz.cli.output import Bar, interruptible, print_json, print_rows, stdout
from vlafuzz.errors import UsageError, check_number

if TYPE_CHECKING:
    from vlafuzz.compare.compare import Sizes
    from vlafuzz.compare.comparison import Comparison

_CONTINUES = "the same command continues"


def command(
    strategies: Annotated[
        str, typer.Option(help="Strategies, separated by commas; the others are compared with the first.")
    ] = "random,nsga2,feedback",
    task: Annotated[str, typer.Option(help="What the robot is told to do.")] = "pick-up",
    policy: PolicyFlag = None,
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
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV, one row per strategy.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print markdown.")] = False,
) -> None:
    """Compare strategies: several runs of each with the same seeds and the same budget of rollouts.

    No run learns from another run's rollouts. All runs are kept in one store; the same command continues
    after an interruption, and with more --repeats, --strategies or --triage-sample it does what is missing.
    """
    from vlafuzz.campaign import config
    from vlafuzz.compare.compare import Sizes, compare
    from vlafuzz.compare.page import write_folder

    names, sizes = _names(strategies), Sizes(solvable, triage_sample)
    _check(names, repeats, seed, sizes, sum((json, csv, markdown)))
    policy = policy or config.default_policy()
    default = f"compare-{config.default_store(task, policy, '', 0).stem[:-3]}"
    store = store or Path("runs") / f"{default}.db"
    run = config.RunConfig(
        task=task,
        policy=policy,
        strategy=names[0],
        budget=budget,
        seed=seed,
        operators=operators,
        vary=listed(vary) or (),
        store=store,
        workers=workers,
        executor=executor,
        address=address,
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    folder = out or (store.with_suffix("") if store.suffix else store.with_name(f"{store.name}-compare"))
    with interruptible(f"interrupted: all trials so far are stored in {store}\nhint: {_CONTINUES}") as bar:
        compared = compare(run, names, repeats, sizes, folder, bar)
    try:
        written = write_folder(compared, folder)
    except OSError as error:
        raise UsageError(f"--out: {error}", hint=f"all runs are stored: {_CONTINUES}") from None
    Bar.note(f"written to {folder}: {', '.join(written)}")
    _print(compared, json=json, csv=csv, markdown=markdown)


def _names(strategies: str) -> list[str]:
    names = [name for name in listed(strategies) or () if name]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise UsageError(f"--strategies: {twice[0]!r} is there twice", hint="name every strategy once")
    if not names:
        raise UsageError(f"--strategies: expected names, got {strategies!r}", hint="random,nsga2")
    return names


def _check(names: list[str], repeats: int, seed: int, sizes: Sizes, formats: int) -> None:
    """Check the flags before anything is planned."""
    from vlafuzz.campaign import config
    from vlafuzz.search.registry import strategy_factory

    check_number("--repeats", repeats, 1)
    check_number("--solvable", sizes.tried, 0)
    check_number("--triage-sample", sizes.triaged, 0)
    if sizes.triaged > sizes.tried:
        message = f"--triage-sample: {sizes.triaged} of the {sizes.tried} failures of --solvable"
        raise UsageError(message, hint=f"give --solvable {sizes.triaged} or more")
    if seed + repeats - 1 > config.MOST:
        raise UsageError(f"--seed: too large for {repeats} repeats, got {seed}", hint="give a smaller one")
    if formats > 1:
        raise UsageError("--json, --csv and --markdown exclude each other", hint="give one of them")
    for name in names:
        strategy_factory(name)


def _print(compared: Comparison, *, json: bool, csv: bool, markdown: bool) -> None:
    from vlafuzz.compare import page

    if json:
        print_json(asdict(compared))
    elif csv:
        print_rows(page.csv_rows(compared), csv=True)
    elif markdown:
        sys.stdout.write(page.markdown(compared))
    else:
        print_comparison(compared)


def print_comparison(compared: Comparison) -> None:
    """Print the tables of a comparison, and what its tests say."""
    from vlafuzz.compare import page

    for title, rows in page.tables(compared).items():
        print_rows(rows, title=title)
    for text in (page.NOTE, *page.sentences(compared)):
        stdout().print(text, soft_wrap=True)
