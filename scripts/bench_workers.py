#!/usr/bin/env python
"""Rollouts a second of campaigns by number of workers and strategy, on all default ranges of a task.

Workers are started and warmed up once, so that the rates are those of long campaigns: strategy, checks, store and
waiting for the last rollouts are included, the start is reported beside them. Campaigns with the same seeds alternate
between the numbers of workers, and must give the same verdicts with all of them. Ratios are to the first number and the
first strategy.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vlafuzz.campaign import config
from vlafuzz.rollouts.executor import Executor
from vlafuzz.store.store import Store

Key = tuple[str, int]  # strategy and number of workers


class Bench:
    """Campaigns with executors that are shared by all strategies."""

    def __init__(self, options: argparse.Namespace, folder: Path, stack: ExitStack) -> None:
        self._options, self._folder, self._stack = options, folder, stack
        self._executors: dict[int, Executor] = {}
        self.starts: dict[int, float] = {}

    def rates(self, repetition: int) -> dict[Key, float]:
        """Rollouts a second of one campaign each."""
        rates: dict[Key, float] = {}
        for strategy in self._options.strategies:
            verdicts = {}
            counts = self._options.workers
            for count in counts if repetition % 2 else reversed(counts):
                rates[strategy, count], verdicts[count] = self._campaign(strategy, count, repetition)
            assert all(same == verdicts[counts[0]] for same in verdicts.values()), verdicts
        return rates

    def start(self, count: int) -> None:
        """Workers that have all evaluated a scene."""
        prepared, began = self._plan("random", count, 0), time.perf_counter()
        executor = self._stack.enter_context(closing(config.make_executor(prepared)))
        scenes = [prepared.space.decode(proposal.genome) for proposal in prepared.strategy.ask(count)]
        for _ in executor.run(enumerate(scenes)):
            pass
        self._executors[count], self.starts[count] = executor, time.perf_counter() - began

    def _campaign(self, strategy: str, count: int, repetition: int) -> tuple[float, dict[str, int]]:
        prepared = self._plan(strategy, count, repetition)
        with Store.open(prepared.store, "write") as store:
            summary = config.fuzz(prepared, store, self._executors[count], lambda tally: None, alone=True)
        return summary.rollouts / summary.seconds, summary.verdicts

    def _plan(self, strategy: str, count: int, repetition: int) -> config.Plan:
        options = self._options
        run = config.RunConfig(
            policy=options.policy,
            task=options.task,
            strategy=strategy,
            budget=options.rollouts,
            batch=options.batch,
            seed=options.seed + repetition,
            store=self._folder / f"{strategy}-{count}-{repetition}.db",
            workers=count,
        )
        return replace(config.plan(run), patience=None)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    with TemporaryDirectory() as folder, ExitStack() as stack:
        bench = Bench(options, Path(folder), stack)
        for count in options.workers:
            bench.start(count)
        played = [bench.rates(repetition) for repetition in range(options.repetitions)]
    base = options.strategies[0], options.workers[0]
    rows = [
        {
            "strategy": strategy,
            "workers": count,
            "start_seconds": bench.starts[count],
            "rollouts_per_second": [rates[strategy, count] for rates in played],
            "ratios": [rates[strategy, count] / rates[base] for rates in played],
        }
        for strategy in options.strategies
        for count in options.workers
    ]
    return {"policy": options.policy, "task": options.task, "rollouts": options.rollouts, "rows": rows}


def lines(report: dict[str, Any]) -> Iterator[str]:
    size = f"campaigns of {report['rollouts']} rollouts, medians [least, most]"
    yield f"{report['policy']} on {report['task']}, {size}\n"
    yield f"{'strategy':12}workers   rollouts/s            an hour   ratio                 start"
    for row in report["rows"]:
        speeds, hourly = row["rollouts_per_second"], 3600 * statistics.median(row["rollouts_per_second"])
        yield (
            f"{row['strategy']:12}{row['workers']:7}   {spread(speeds):22}{hourly:7.0f}   "
            f"{spread(row['ratios']):22}{row['start_seconds']:5.1f} s"
        )


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} [{min(values):.2f}, {max(values):.2f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--policy", default="pinhole")
    parser.add_argument("--task", default="pick-up")
    parser.add_argument("--strategies", nargs="+", default=["random"])
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--rollouts", type=int, default=100, help="per campaign")
    parser.add_argument("--batch", type=int, help="as in `vlafuzz run`")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0, help="of the first campaign")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    if min(options.rollouts, options.repetitions, *options.workers) < 1:
        parser.error("expected at least 1 worker, 1 rollout and 1 repetition")
    report = measure(options)
    print(json.dumps(report, indent=2) if options.json else "\n".join(lines(report)))


if __name__ == "__main__":
    main()
