#!/usr/bin/env python
"""Strategies side by side, at equal budget and with paired seeds, on four grounds.

    toy       planted failures in closed form, no physics
    replay    published labels of real VLAs (VLATest's folder `data`) as oracle: choose 200 of 1,000 scenes
    pinhole   the real simulator, a scripted policy that sees through a pinhole, physics only
    mini      the real simulator, a learned policy, rendered

Ratios are of means, with 95 % bootstrap intervals over paired runs; A12 says how often a run has more than
one of random (Vargha and Delaney 2000), ties counted half; p is Mann and Whitney's, corrected after Holm.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np
from strategies import replay, results, simulated, toy

from vlafuzz.cli.compare import print_comparison
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.statistics import ratio, ratio_interval

SIGNALS = ("smooth", "flat", "noise")
ALL = list(STRATEGIES)


def planted(options: argparse.Namespace) -> dict[str, Any]:
    cases = toy.cases(options.shares, options.signals, options.seed)
    found = _run(cases, options)
    tables = {measure: results.rows(found, measure) for measure in ("cells", "failures")}
    results.show(tables["cells"])
    return dict(tables)


def replayed(options: argparse.Namespace) -> dict[str, Any]:
    cases = replay.cases(options.data)
    table = results.rows(_run(cases, options), "found")
    means = {(row["case"], row["strategy"]): row["mean"] for row in table}
    for row, case in ((row, case) for row in table for case in cases if case.name == row["case"]):
        base, most = means[case.name, results.RANDOM], case.most(options.budget)
        row |= {"most": most, "gain": (row["mean"] - base) / max(most - base, 1)}
    results.show(table)
    rare = [row for row in table if row["case"].endswith("passes")]
    pooled = {name: _pooled(rare, name) for name in options.strategies if name != results.RANDOM}
    print("\nof what is possible over random, and the rare outcome of all VLAs together beside random's:")
    for name, row in pooled.items():
        gains = ", ".join(
            f"{each['case']} {each['gain']:.0%}"
            for each in table
            if each["strategy"] == name and "failures" in each["case"]
        )
        print(f"{name}: {results.times(row)}; {gains}")
    return {"pooled": pooled, "found": table}


def _pooled(rare: list[results.Row], name: str) -> results.Row:
    """The rare outcome over all VLAs: the n-th runs of all together are the n-th run."""
    ours, theirs = (
        np.sum([row["runs"] for row in rare if row["strategy"] == each], axis=0).tolist()
        for each in (name, results.RANDOM)
    )
    interval = ratio_interval(ours, theirs)
    low, high = interval or (None, None)
    return {"ratio": ratio(ours, theirs), "low": low, "high": high, "runs": ours}


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    compared = simulated.simulate(
        options.tasks,
        options.strategies,
        range(options.seed, options.seed + options.repeats),
        policy=options.ground,
        budget=options.budget,
        witnesses=options.witnesses,
        workers=options.workers,
        each=options.each,
        folder=options.stores,
    )
    for each in compared.values():
        print_comparison(each)
    return simulated.contents(compared)


def _run(cases: list[Any], options: argparse.Namespace) -> dict[str, dict[str, list[dict[str, float]]]]:
    seeds = range(options.seed, options.seed + options.repeats)
    return results.run(cases, options.strategies, seeds=seeds, budget=options.budget, workers=options.workers)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    grounds = parser.add_subparsers(dest="ground", required=True)
    one = _ground(grounds, "toy", planted, strategies=ALL, budget=300, repeats=20)
    one.add_argument("--shares", nargs="+", type=float, default=[0.1, 0.01, 0.005], help="that fail")
    one.add_argument("--signals", nargs="+", default=list(SIGNALS), choices=SIGNALS)
    one = _ground(grounds, "replay", replayed, strategies=ALL, budget=200, repeats=20)
    one.add_argument("data", type=Path, help="folder with VLATest's scene files and all-correct-task.json")
    for name, repeats, tasks in (
        ("pinhole", 20, ["pick-up", "put-on"]),
        ("mini", 5, ["pick-up", "move-near"]),
    ):
        one = _ground(grounds, name, simulate, strategies=ALL, budget=300, repeats=repeats)
        one.add_argument("--tasks", nargs="+", default=tasks)
        one.add_argument("--witnesses", type=int, default=5, help="failures of a run that the expert tries")
        one.add_argument("--each", type=int, default=1, help="processes of one run: outcomes stay the same")
        one.add_argument("--stores", type=Path, default=Path("runs") / name, help="folder of the stores")
    options = parser.parse_args()
    if options.ground in ("toy", "replay") and results.RANDOM not in options.strategies:
        options.strategies.insert(0, results.RANDOM)
    settings = {key: value for key, value in vars(options).items() if key in ("budget", "repeats", "seed")}
    results.write(options.out, {"ground": options.ground, **settings, **options.work(options)})


def _ground(grounds: Any, name: str, work: Any, *, strategies: list[str], budget: int, repeats: int) -> Any:
    one = grounds.add_parser(name)
    one.set_defaults(work=work)
    one.add_argument("--strategies", nargs="+", default=strategies, metavar="NAME")
    one.add_argument("--budget", type=int, default=budget, help="rollouts a run")
    one.add_argument("--repeats", type=int, default=repeats, help="runs a strategy")
    one.add_argument("--seed", type=int, default=1, help="of the first run; the others count on")
    one.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="runs at a time")
    one.add_argument("--out", type=Path, help="JSON file for the raw results")
    return one


if __name__ == "__main__":
    main()
