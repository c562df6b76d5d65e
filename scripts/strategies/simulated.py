"""Strategies on the real simulator. Every run has a store of its own, so that runs can be parallel.

The n-th runs of all strategies have the same seed and budget. Runs whose store exists are not repeated: a second call
resumes them, or only counts. The measures are those of `vlafuzz compare`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from strategies.results import side_by_side
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.campaign.launch import WantedRun, do_missing, stored_run
from vlafuzz.common.watch import SILENT
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.jobs import runner_of_run
from vlafuzz.lab.compare.certified import certify, uncertified
from vlafuzz.lab.compare.comparison import Comparison, compare_runs
from vlafuzz.lab.compare.figures import CountedRun, count_run, with_causes
from vlafuzz.lab.compare.plots import plot
from vlafuzz.lab.compare.verdicts import corrected
from vlafuzz.store.store import Store
from vlafuzz.worlds.manipulation.operator_set import stored_operators
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace


@dataclass(frozen=True)
class Job:
    """One run. ``limit``: rollouts of its triage; ``workers``: its processes."""

    task: str
    strategy: str
    seed: int
    policy: str
    budget: int
    limit: int
    workers: int
    store: Path

    def play(self) -> CountedRun:
        """Run, resume, triage, or only count."""
        config = RunConfig(
            task=self.task,
            strategy=self.strategy,
            seed=self.seed,
            policy=self.policy,
            budget=self.budget,
            workers=self.workers,
            store=self.store,
        )
        with Store.open(self.store, "write") as store:
            run = WantedRun(
                name=str(self.store),
                budget=self.budget,
                plan=partial(plan, config),
                stored=stored_run(store.runs()),
                group=None,
            )
            do_missing(store, [run], SILENT)
            if self.limit:
                left = uncertified(store, store.runs(), self.limit)
                certify(store, partial(runner_of_run, self.store), left, self.limit)
        return self._counted()

    def _counted(self) -> CountedRun:
        with Store.open(self.store) as store:
            (run,) = store.runs()
            if run.manifest.budget != self.budget:
                message = f"{self.store}: has a budget of {run.manifest.budget}, not {self.budget}"
                raise UsageError(message, hint="give another --stores")
            operators = stored_operators(self.store, run.manifest)
            counted = count_run(store, run, SearchSpace(operators, load_catalogue(), self.task).embed)
            return with_causes(store, [counted], self.limit)[0]


def simulate(
    tasks: Sequence[str],
    strategies: Sequence[str],
    seeds: Sequence[int],
    *,
    policy: str,
    budget: int,
    limit: int,
    workers: int,
    processes: int,
    folder: Path,
) -> dict[str, Comparison]:
    """Play missing runs, ``workers`` at a time with ``processes`` each; returns one comparison per task.

    ``strategies[0]`` is the reference.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [
        Job(task, name, seed, policy, budget, limit, processes, folder / f"{task}-{policy}-{name}-{seed}.db")
        for seed in seeds
        for task in tasks
        for name in strategies
    ]
    played = side_by_side(jobs, Job.play, workers)
    ran = dict(zip(jobs, played, strict=True))
    compared = {}
    for task in tasks:
        counted = {
            name: [run for job, run in ran.items() if (job.task, job.strategy) == (task, name)] for name in strategies
        }
        compared[task] = compare_runs(counted, strategies[0], store=str(folder), limit=limit)
        (folder / task).mkdir(exist_ok=True)
        plot(compared[task], folder / task)
    return _corrected(compared)


def _corrected(compared: dict[str, Comparison]) -> dict[str, Comparison]:
    """With p-values that are corrected for the tests of all tasks."""
    tests = iter(corrected([pair for comparison in compared.values() for pair in comparison.against]))
    return {
        task: replace(comparison, against=tuple(islice(tests, len(comparison.against))))
        for task, comparison in compared.items()
    }


def contents(compared: dict[str, Comparison]) -> dict[str, Any]:
    """The comparisons as JSON values."""
    return {task: asdict(comparison) for task, comparison in compared.items()}
