#!/usr/bin/env python
"""Speed-up of a campaign by several workers: pinhole on pick-up, physics only, as in `vlafuzz run`.

Campaigns with the same seeds alternate between one worker (in this process) and several (processes). Workers
are started once, and the start is reported separately; the time of a campaign includes strategy, checks and
store. Both must give the same verdicts.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vlafuzz.campaign import config, launch
from vlafuzz.execute.base import Executor
from vlafuzz.store.store import Store

GOAL = 1.6  # speed-up by two workers


def plan(options: argparse.Namespace, folder: str, workers: int, repetition: int) -> config.Plan:
    return config.plan(
        config.RunConfig(
            policy="pinhole",
            budget=options.rollouts,
            seed=options.seed + repetition,
            store=Path(folder) / f"{workers}-{repetition}.db",
            workers=workers,
        )
    )


def start(options: argparse.Namespace, folder: str, workers: int, stack: ExitStack) -> tuple[Executor, float]:
    """An executor whose workers have all evaluated a scene, and the seconds that this took."""
    began, prepared = time.perf_counter(), plan(options, folder, workers, 0)
    executor = stack.enter_context(closing(launch.make_executor(prepared)))
    scenes = [prepared.space.decode(proposal.genome) for proposal in prepared.strategy.ask(workers)]
    for _ in executor.run((number, [scene]) for number, scene in enumerate(scenes)):
        pass
    return executor, time.perf_counter() - began


def campaign(prepared: config.Plan, executor: Executor) -> tuple[float, dict[str, int]]:
    """Rollouts per second, and the verdicts."""
    with Store.open(prepared.store, "write") as store:
        summary = launch.fuzz(prepared, store, executor, lambda tally: None)
    return summary.rollouts / summary.seconds, summary.verdicts


def measure(options: argparse.Namespace) -> dict[str, Any]:
    counts, speeds = (1, options.workers), {1: [], options.workers: []}
    with TemporaryDirectory() as folder, ExitStack() as stack:
        started = {count: start(options, folder, count, stack) for count in counts}
        for repetition in range(options.repetitions):
            verdicts = {}
            for count in counts if repetition % 2 else reversed(counts):
                prepared = plan(options, folder, count, repetition)
                speed, verdicts[count] = campaign(prepared, started[count][0])
                speeds[count].append(speed)
            assert verdicts[1] == verdicts[options.workers], verdicts
    return {
        "rollouts": options.rollouts,
        "repetitions": options.repetitions,
        "workers": [
            {"workers": count, "start_seconds": started[count][1], "rollouts_per_second": speeds[count]}
            for count in counts
        ],
        "ratios": [many / single for single, many in zip(*speeds.values(), strict=True)],
    }


def rows(report: dict[str, Any]) -> Iterator[str]:
    size = f"{report['repetitions']} campaigns of {report['rollouts']} rollouts each, medians [least, most]"
    yield f"pinhole on pick-up, physics only: {size}\n"
    yield "workers   rollouts/s            start-up"
    for row in report["workers"]:
        speeds = row["rollouts_per_second"]
        yield f"{row['workers']:7}   {spread(speeds):22}{row['start_seconds']:6.1f} s"
    ratio = statistics.median(report["ratios"])
    yield f"\nratio     {spread(report['ratios'])}"
    if report["workers"][1]["workers"] == 2:
        yield f"goal      {GOAL:.2f}: {'reached' if ratio >= GOAL else 'MISSED'}"


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} [{min(values):.2f}, {max(values):.2f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rollouts", type=int, default=100, help="per campaign")
    parser.add_argument("--workers", type=int, default=2, help="to compare with one")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0, help="of the first campaign")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    if min(options.rollouts, options.repetitions) < 1 or options.workers < 2:
        parser.error("expected at least 2 workers, 1 rollout and 1 repetition")
    report = measure(options)
    print(json.dumps(report, indent=2) if options.json else "\n".join(rows(report)))


if __name__ == "__main__":
    main()
