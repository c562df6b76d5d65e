"""``vlafuzz compare``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from vlafuzz.cli.flags import ConfigFlag, JsonFlag, VideosFlag, configured, listed, option, typed, with_run_options
from vlafuzz.cli.output import interruptible, print_json, print_lines, print_rows
from vlafuzz.errors import UsageError, check_number

_ONE = 200  # rollouts that triage of one failure takes at most, about


@with_run_options(
    *("task", "policy", "budget", "seed", "operators", "vary", "workers", "executor", "store"),
    task="the first: `vlafuzz list worlds`",
    budget="100",
    store="runs/compare-….db",
)
def command(
    *,
    strategies: Annotated[
        str, option("Strategies, separated by commas; the others are compared with the first.")
    ] = "random,causes",
    repeats: Annotated[int, option("Runs of every strategy; the seeds count on from --seed.")] = 10,
    triage_rollouts: Annotated[
        int | None,
        option(
            "Most rollouts of triage for each run, beside its budget; 0 to judge by failures alone.",
            "as many as --budget, at least 200",
        ),
    ] = None,
    out: Annotated[Path | None, option("Write a page with each cause to this HTML file.")] = None,
    videos: VideosFlag = True,
    json: JsonFlag = False,
    config: ConfigFlag = None,
    **given: Any,
) -> None:
    """Compare strategies: several runs of each with the same seeds and the same budget of rollouts.

    They are judged by the distinct causes that triage certifies, within the same limit of rollouts for every run, then
    by failures and by the interval of the failure probability. No run learns from another run's rollouts. All is kept
    in one store; the same command continues after an interruption, and with more --repeats, --strategies or
    --triage-rollouts it does what is missing.
    """
    from vlafuzz.campaign.config import BUDGET, MOST, RunConfig, default_store
    from vlafuzz.cli.report import with_own_films, write
    from vlafuzz.lab.compare import compare
    from vlafuzz.lab.comparison import rows, sentences, view_of_comparison
    from vlafuzz.report.page import check_place
    from vlafuzz.report.sources import view_of
    from vlafuzz.worlds import default_policy, default_task

    names = _names(strategies)
    if out:  # what is wrong with it is said before hours go by
        check_place(out)
    limit = max(given["budget"] or BUDGET, _ONE) if triage_rollouts is None else triage_rollouts
    check_number("--repeats", repeats, 1)
    check_number("--triage-rollouts", limit, 0)
    seed, task = given["seed"] or 0, given["task"] or default_task()
    if seed + repeats - 1 > MOST:
        raise UsageError(f"--seed: too large for {repeats} repeats, got {seed}", hint="give a smaller one")
    policy = given["policy"] or default_policy(task)
    store = given["store"] or Path("runs") / f"compare-{default_store(task, policy, 0).stem[:-2]}.db"
    of_all = configured(given) | {"task": task, "policy": policy, "store": store}
    run = RunConfig(**of_all, strategy=names[0], command=typed())
    stored = f"interrupted: all results so far are stored in {store}\nhint: the same command continues"
    with interruptible(stored) as bar:
        compared = compare(run, names, repeats, limit, bar)
    if json:
        print_json(asdict(compared))
    else:
        print_rows(rows(compared), title=compared.title)
        print_lines(*sentences(compared))
    if out:
        view = view_of_comparison(compared, view_of(store))
        write(out, with_own_films(view, store) if videos else view)


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
