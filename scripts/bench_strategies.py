#!/usr/bin/env python
"""What strategies find on the real simulator: paired runs at equal budget, each in a store of its own.

The n-th repeats of all strategies have the same seed. A failure is a distinct failing scene, a cell what
vlafuzz.scoring.cell says, a severity the mean over a run's failures. Medians over the repeats, and ranges.
Runs that a store in the folder has already are not run again: a second call goes on, or only prints.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import fmean, median
from typing import Any

from vlafuzz import config
from vlafuzz.corpus.store import Corpus
from vlafuzz.outcome import Verdict
from vlafuzz.tasks.tabletop import TASKS

ONE_THREAD = {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
MEASURES = ("failures", "cells", "severity", "invalid")


@dataclass(frozen=True)
class Job:
    """One run."""

    task: str
    strategy: str
    seed: int
    subject: str
    budget: int
    store: Path

    def run(self) -> dict[str, Any]:
        """Run it, go on with it, or only read it; a row of figures."""
        flags = {
            name: getattr(self, name) for name in ("task", "strategy", "seed", "subject", "budget", "store")
        }
        if not self.store.exists():
            config.start(config.plan(config.RunConfig(**flags)), lambda tally: None)
        elif not self._finished():
            config.start(config.resume(flags), lambda tally: None)
        return self._figures()

    def _finished(self) -> bool:
        with Corpus.open(self.store) as corpus:
            return all(run.status in ("finished", "stopped") for run in corpus.runs())

    def _figures(self) -> dict[str, Any]:
        with Corpus.open(self.store) as corpus:
            (run,) = corpus.runs()
            trials = {trial.scene.digest: trial for trial in corpus.trials(run.id)}.values()
        failures = [trial for trial in trials if trial.outcome.verdict is Verdict.FAILED]
        return {
            "task": self.task,
            "strategy": self.strategy,
            "seed": self.seed,
            "failures": len(failures),
            "cells": len({trial.cell for trial in failures}),
            "severity": fmean(trial.severity for trial in failures) if failures else 0.0,
            "invalid": sum(trial.outcome.verdict is Verdict.INVALID for trial in trials),
            "seconds": run.seconds,
        }


def show(rows: Sequence[dict[str, Any]], options: argparse.Namespace) -> None:
    print(f"{'':11}{'':10}" + "".join(f"{name:>20}" for name in MEASURES))
    for task in options.tasks:
        for strategy in options.strategies:
            line = f"{task:11}{strategy:10}"
            for name in MEASURES:
                values = [row[name] for row in rows if (row["task"], row["strategy"]) == (task, strategy)]
                digits = 2 if name == "severity" else 0
                line += (
                    f"{median(values):.{digits}f} ({min(values):.{digits}f}-{max(values):.{digits}f})".rjust(
                        20
                    )
                )
            print(line)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--strategies", nargs="+", default=["random", "nsga2", "feedback"])
    parser.add_argument("--subject", default="pinhole")
    parser.add_argument("--budget", type=int, default=300, help="rollouts a run")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--out", type=Path, default=Path("runs/strategies"), help="folder of the stores")
    parser.add_argument("--json", action="store_true", help="print one JSON array instead")
    options = parser.parse_args()
    os.environ.update(ONE_THREAD)
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = [
        Job(
            task,
            strategy,
            seed,
            options.subject,
            options.budget,
            options.out / f"{task}-{strategy}-{seed}.db",
        )
        for task in options.tasks
        for seed in range(1, options.repeats + 1)
        for strategy in options.strategies
    ]
    with get_context("spawn").Pool(options.workers, maxtasksperchild=1) as pool:
        rows = list(pool.imap(Job.run, jobs, chunksize=1))
    if options.json:
        print(json.dumps(rows, indent=2))
    else:
        show(rows, options)


if __name__ == "__main__":
    main()
