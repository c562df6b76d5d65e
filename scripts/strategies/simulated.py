"""Simulated: strategies on the real simulator. Each run has a store of its own, so that they go side by side.

The n-th runs of all strategies have the same seed and the same budget. Runs that a store in the folder has
already are not run again: a second call goes on, or only counts. What is counted is what `vlafuzz compare`
counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from strategies.results import side_by_side
from vlafuzz.campaign import config, launch
from vlafuzz.campaign.resume import resume
from vlafuzz.compare.comparison import Comparison, compare_runs
from vlafuzz.compare.failures import CountedRun, count_run
from vlafuzz.compare.plots import plot
from vlafuzz.compare.solvable import Sampled, Solvable, Witnesses, sample, solvable
from vlafuzz.conditions.operators import stored_operators
from vlafuzz.errors import UsageError
from vlafuzz.objects import load_catalogue
from vlafuzz.space import SearchSpace
from vlafuzz.store.store import Store
from vlafuzz.triage.scene_runner import SimulatorSceneRunner


@dataclass(frozen=True)
class Ran:
    """A run, counted; of a sample of its failures, those that the expert solves."""

    found: CountedRun
    sampled: tuple[Sampled, ...]
    solved: dict[str, bool]

    def numbered(self, number: int) -> Ran:
        """With another number of the run: in a store of its own each is the first."""
        found = replace(self.found, run=replace(self.found.run, id=number))
        return replace(self, found=found, sampled=tuple(each._replace(run=number) for each in self.sampled))


@dataclass(frozen=True)
class Job:
    """One run. ``witnesses`` is how many of its failures the expert tries, ``workers`` its processes."""

    task: str
    strategy: str
    seed: int
    policy: str
    budget: int
    witnesses: int
    workers: int
    store: Path

    def play(self) -> Ran:
        """Run it, go on with it, or only count."""
        flags = {
            name: getattr(self, name)
            for name in ("task", "strategy", "seed", "policy", "budget", "workers", "store")
        }
        if not self.store.exists():
            launch.start(config.plan(config.RunConfig(**flags)), lambda tally: None)
        elif not self._finished():
            launch.start(resume(flags), lambda tally: None)
        return self._counted()

    def _finished(self) -> bool:
        with Store.open(self.store) as store:
            return all(run.status in ("finished", "stopped") for run in store.runs())

    def _counted(self) -> Ran:
        with Store.open(self.store) as store:
            (run,) = store.runs()
            if run.manifest.budget != self.budget:
                told = f"{self.store}: has a budget of {run.manifest.budget}, not {self.budget}"
                raise UsageError(told, hint="give another --stores")
            operators = stored_operators(self.store, run.manifest)
            counted = count_run(store, run, SearchSpace(operators, load_catalogue(), self.task).embed)
        sampled = sample([counted], self.witnesses)
        scenes = [each.scene for each in sampled]
        witnesses = Witnesses(self.store.with_suffix(".witnesses.jsonl"), run.manifest)
        if witnesses.missing(scenes):
            with closing(SimulatorSceneRunner(self.store, run.manifest)) as runner:
                witnesses.find(scenes, runner, lambda done, of: None)
        return Ran(counted, tuple(sampled), dict(witnesses.solved))


def simulate(
    tasks: Sequence[str],
    strategies: Sequence[str],
    seeds: Sequence[int],
    *,
    policy: str,
    budget: int,
    witnesses: int,
    workers: int,
    each: int,
    folder: Path,
) -> dict[str, Comparison]:
    """Do what is missing, ``workers`` runs at a time of ``each`` processes; a comparison a task.

    ``strategies[0]`` is the reference.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [
        Job(task, name, seed, policy, budget, witnesses, each, folder / f"{task}-{policy}-{name}-{seed}.db")
        for seed in seeds
        for task in tasks
        for name in strategies
    ]
    played = side_by_side(jobs, Job.play, workers)
    ran = {job: its.numbered(number) for number, (job, its) in enumerate(zip(jobs, played, strict=True))}
    compared = {}
    for task in tasks:
        of = {
            name: [its for job, its in ran.items() if (job.task, job.strategy) == (task, name)]
            for name in strategies
        }
        compared[task] = compare_runs(
            {name: [each.found for each in its] for name, its in of.items()},
            strategies[0],
            store=str(folder),
            solvable={name: _solvable(its) for name, its in of.items()},
        )
        (folder / task).mkdir(exist_ok=True)
        plot(compared[task], folder / task)
    return compared


def _solvable(its: Sequence[Ran]) -> Solvable | None:
    sampled = list(chain.from_iterable(each.sampled for each in its))
    return solvable(sampled, {digest: so for each in its for digest, so in each.solved.items()})


def contents(compared: dict[str, Comparison]) -> dict[str, Any]:
    """For a file."""
    return {task: asdict(each) for task, each in compared.items()}
