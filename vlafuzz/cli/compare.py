"""``vlafuzz compare``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from vlafuzz.cli.flags import (
    ConfigFlag,
    ExecutorFlag,
    JsonFlag,
    OperatorsFlag,
    PolicyFlag,
    VaryFlag,
    WorkersFlag,
    listed,
    option,
    option_of,
)
from vlafuzz.cli.output import Bar, interruptible, print_json, print_lines, print_rows
from vlafuzz.errors import UsageError, check_number

_CONTINUES = "the same command continues"
_ONE = 200  # rollouts that triage of one failure takes at most, about


def command(
    strategies: Annotated[
        str, option("Strategies, separated by commas; the others are compared with the first.")
    ] = "random,causes",
    task: Annotated[str | None, option_of("task", "the first: `vlafuzz list worlds`")] = None,
    policy: PolicyFlag = None,
    budget: Annotated[int, option("Policy rollouts of every run.")] = 100,
    repeats: Annotated[int, option("Runs of every strategy.")] = 10,
    seed: Annotated[int, option("Of the first run of every strategy; the others count on.")] = 0,
    operators: OperatorsFlag = None,
    vary: VaryFlag = None,
    workers: WorkersFlag = None,
    executor: ExecutorFlag = None,
    triage_rollouts: Annotated[
        int | None,
        option(
            "Most rollouts of triage for each run, beside its budget; 0 to judge by failures alone.",
            "as many as --budget, at least 200",
        ),
    ] = None,
    store: Annotated[Path | None, option("Where to keep all runs.", "runs/compare-….db")] = None,
    out: Annotated[Path | None, option("Folder for plot and JSON.", "runs/compare-…")] = None,
    json: JsonFlag = False,
    config: ConfigFlag = None,
) -> None:
    """Compare strategies: several runs of each with the same seeds and the same budget of rollouts.

    They are judged by the distinct causes that triage certifies, within the same limit of rollouts for every run, then
    by failures and by the interval of the failure probability. No run learns from another run's rollouts. All is kept
    in one store; the same command continues after an interruption, and with more --repeats, --strategies or
    --triage-rollouts it does what is missing.
    """
    from vlafuzz.campaign.config import MOST, RunConfig, default_store
    from vlafuzz.doctor.exam import speed_of
    from vlafuzz.lab.compare.compare import compare
    from vlafuzz.lab.compare.comparison import rows, sentences, write_folder
    from vlafuzz.worlds import default_policy, default_task

    names, limit = _names(strategies), max(budget, _ONE) if triage_rollouts is None else triage_rollouts
    check_number("--repeats", repeats, 1)
    check_number("--triage-rollouts", limit, 0)
    if seed + repeats - 1 > MOST:
        raise UsageError(f"--seed: too large for {repeats} repeats, got {seed}", hint="give a smaller one")
    task = task or default_task()
    policy = policy or default_policy(task)
    store = store or Path("runs") / f"compare-{default_store(task, policy, 0).stem[:-2]}.db"
    run = RunConfig(
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
        command=shlex.join(["vlafuzz", *sys.argv[1:]]),
    )
    folder = out or (store.with_suffix("") if store.suffix else store.with_name(f"{store.name}-compare"))
    with interruptible(f"interrupted: all results so far are stored in {store}\nhint: {_CONTINUES}") as bar:
        compared = compare(run, names, repeats, limit, folder, bar, speed_of)
    if json:
        print_json(asdict(compared))
    else:
        print_rows(rows(compared), title=compared.title)
        print_lines(*sentences(compared))
    try:
        written = write_folder(compared, folder)
    except OSError as error:
        raise UsageError(f"--out: {error}", hint=f"all runs are stored: {_CONTINUES}") from None
    Bar.note(f"written to {folder}: {', '.join(written)}")


def _names(strategies: str) -> list[str]:
    from vlafuzz.search.registry import strategy_factory

    names = [name for name in listed(strategies) or () if name]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UsageError(f"--strategies: {twice[0]!r} is there twice", hint="name every strategy once")
    if not names:
        raise UsageError(f"--strategies: expected names, got {strategies!r}", hint="random,causes")
    for name in names:
        strategy_factory(name)
    return names
