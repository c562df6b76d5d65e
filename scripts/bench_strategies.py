#!/usr/bin/env python
"""Compare strategies at equal budget and with paired seeds, on two benchmarks without physics.

    faults    policies with planted faults: how many are identified by search and triage
    toy       planted failures in closed form

`vlafuzz compare` compares strategies in the simulator.
The n-th runs of all strategies have the same seed and are compared as pairs: ratios of means with 95 % intervals, the
numbers of pairs with more and with fewer, and p by Wilcoxon's signed-rank test with Holm's correction for all tests of
a command.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # tests/search/toy.py

from strategies import identified, results, toy
from strategies.arms import SPLITS, arms
from strategies.faults import DENSITIES
from strategies.identified_plot import plot

from vlafuzz.search.registry import STRATEGIES

SIGNALS = ("smooth", "flat", "noise")
ALL = list(STRATEGIES)
TUNING = 100  # first seed of the worlds that something may be tuned on; figures are reported for those below


def identify(options: argparse.Namespace) -> dict[str, Any]:
    tuned = options.tuned and identified.tuned(json.loads(options.tuned.read_text(encoding="utf-8")))
    jobs = []
    for policy, density, seed in product(options.policies or [None], options.densities, _seeds(options)):
        ground = identified.SIMULATOR if policy else density
        settings = identified.settings(ground, options.arms, options.budgets, options.splits, tuned or {})
        jobs.append(identified.Job(density, seed, policy, ground, settings))
    content = identified.play(jobs, options.workers)
    identified.show(content)
    if options.plot:
        plot(content["identified"], options.plot)
    return {"budgets": options.budgets, **content}


def planted(options: argparse.Namespace) -> dict[str, Any]:
    cases = toy.cases(options.shares, options.signals, options.seed)
    runs = _run(cases, options)
    table = results.rows(runs, "cells", "failures")
    tables = {name: [row for row in table if row["measure"] == name] for name in ("cells", "failures")}
    results.show(tables["cells"])
    return dict(tables)


def _run(cases: list[Any], options: argparse.Namespace) -> dict[str, dict[str, list[dict[str, float]]]]:
    return results.run(cases, options.strategies, seeds=_seeds(options), budget=options.budget, workers=options.workers)


def _seeds(options: argparse.Namespace) -> range:
    return range(options.seed, options.seed + options.repeats)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    grounds = parser.add_subparsers(dest="ground", required=True)
    ground = _common(grounds, "faults", identify, repeats=30, seed=TUNING)
    ground.add_argument(
        "--arms", nargs="+", choices=arms(), default=list(arms()), metavar="ARM", help=", ".join(arms())
    )
    ground.add_argument("--densities", nargs="+", choices=DENSITIES, default=list(DENSITIES))
    ground.add_argument("--policies", nargs="+", help="that get the faults, in the simulator; else no physics")
    ground.add_argument("--budgets", nargs="+", type=int, default=[150, 300, 600, 1200], help="rollouts in all")
    ground.add_argument("--splits", nargs="+", type=float, default=SPLITS, help="shares for search, before triage")
    ground.add_argument("--tuned", type=Path, help="raw results whose best splits are used")
    ground.add_argument("--plot", type=Path, help="PNG file")
    ground = _ground(grounds, "toy", planted, strategies=ALL, budget=300, repeats=20)
    ground.add_argument("--shares", nargs="+", type=float, default=[0.1, 0.01, 0.005], help="of scenes that fail")
    ground.add_argument("--signals", nargs="+", default=list(SIGNALS), choices=SIGNALS)
    options = parser.parse_args()
    if options.ground == "toy" and results.RANDOM not in options.strategies:
        options.strategies.insert(0, results.RANDOM)
    settings = {key: value for key, value in vars(options).items() if key in ("budget", "repeats", "seed")}
    results.write(options.out, {"ground": options.ground, **settings, **options.work(options)})


def _ground(grounds: Any, name: str, work: Any, *, strategies: list[str], budget: int, repeats: int) -> Any:
    ground = _common(grounds, name, work, repeats=repeats, seed=1)
    ground.add_argument("--strategies", nargs="+", default=strategies, metavar="NAME")
    ground.add_argument("--budget", type=int, default=budget, help="rollouts per run")
    return ground


def _common(grounds: Any, name: str, work: Any, *, repeats: int, seed: int) -> Any:
    ground = grounds.add_parser(name)
    ground.set_defaults(work=work)
    ground.add_argument("--repeats", type=int, default=repeats, help="runs per strategy")
    ground.add_argument("--seed", type=int, default=seed, help="of the first run; the others follow")
    ground.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="runs at a time")
    ground.add_argument("--out", type=Path, help="JSON file for the raw results")
    return ground


if __name__ == "__main__":
    main()
