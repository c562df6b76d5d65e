"""Study: the steps of a repair for several arms and repetitions."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from repair import judged, shown, steps
from repair.arms import ARMS, KINDS
from repair.steps import once, side_by_side, together, train
from vlafuzz.policies.mini.policy import SHIPPED
from vlafuzz.worlds.tabletop.tasks import TASKS

ROUND = 100  # seeds from one round to the next
Policies = Mapping[str, Path]  # weights by name: arm and repetition, such as failed-0
Training = dict[str, Future[Path]]


@dataclass
class Study:
    """What is done with these options; ``lanes``: threads that wait for trainings."""

    options: argparse.Namespace
    lanes: ThreadPoolExecutor

    def first(self) -> Training:
        """Begin the first round of all arms, which share the runs of a repetition."""
        repeats = range(self.options.repeats)
        shipped = {f"shipped-{number}": SHIPPED for number in repeats}
        self.fuzz(shipped, self.options.seed)
        training: Training = {}
        for number, before in enumerate(shipped):
            arms = {f"{arm}-{number}": arm for arm in self.options.arms}
            training |= self._repair(before, SHIPPED, arms)
        return training

    def second(self, trained: Policies) -> Training:
        """Begin the second round of some arms, each with what its own weights fail in."""
        again = {f"{arm}-{number}": arm for number in range(self.options.repeats) for arm in self.options.again}
        self.fuzz({name: trained[name] for name in again}, self.options.seed + ROUND)
        training: Training = {}
        for before, arm in again.items():
            name = f"{arm}-again-{number_of(before)}"
            training |= self._repair(before, trained[before], {name: arm})
        return training

    def judge(self, training: Training) -> None:
        """Write how every policy ends in the same scenes: random ones, and nominal ones of all tasks."""
        side_by_side(self._judging(training), self.options.workers, "judged")

    def _judging(self, training: Training) -> Iterator[judged.Job]:
        options, names = self.options, {one: name for name, one in training.items()}
        for trained in as_completed(names):
            out, weights = options.out / "judged" / names[trained], trained.result()
            for task in options.tasks:
                yield from judged.jobs(weights, task, "random", options.first, options.scenes, out)
            for task in TASKS:
                yield from judged.jobs(weights, task, "nominal", options.first, options.nominal, out)

    def fuzz(self, policies: Policies, seed: int) -> None:
        """The stores of each policy's runs; the n-th repetition has the n-th seed."""
        options = self.options
        runs = [(name, task) for name in policies for task in options.tasks]
        workers = max(1, options.workers // max(1, len(runs)))

        def run(name: str, task: str) -> None:
            store = options.out / "found" / name / f"{task}.db"
            steps.fuzz(policies[name], task, options.budget, seed + number_of(name), store, workers)

        with ThreadPoolExecutor(max(1, len(runs))) as threads:
            for one in [threads.submit(run, *each) for each in runs]:
                one.result()

    def _repair(self, before: str, init: Path, arms: Mapping[str, str]) -> Training:
        """Demonstrate what the policy ``before`` fails in, and begin to train it; ``arms`` by new names."""
        options, out = self.options, self.options.out
        demos = self._demonstrate(before, init, set(arms.values()))
        earlier = out / "arms" / before
        replayed = [*(out / "old").iterdir(), *(earlier.iterdir() if earlier.exists() else ())]
        old = together(out / "replayed" / before, sorted(replayed))
        training: Training = {}
        for place, (name, arm) in enumerate(arms.items()):
            parts = [
                part
                for kind, share in ARMS[arm].items()
                for part in shown.parts_of(demos[kind], options.tasks, round(share * options.demos))
            ]
            folder = together(out / "arms" / name, parts)
            recipe = [*options.recipe.split(), "--seed", str(options.seed + number_of(name))]
            gpu = (place + number_of(name)) % options.gpus if options.gpus else None
            training[name] = self.lanes.submit(train, folder, old, init, out / "mini" / name, recipe, gpu)
        return training

    def _demonstrate(self, before: str, init: Path, arms: set[str]) -> dict[str, Path]:
        """The folders of all demonstrations that these arms need, by kind."""
        options, folders, jobs = self.options, dict[str, Path](), list[shown.Job]()
        with ExitStack() as stack:
            for kind in KINDS:
                number = round(max(ARMS[arm].get(kind, 0.0) for arm in arms) * options.demos)
                if not number:
                    continue
                folders[kind] = options.out / "demos" / before / f"{kind}-{number}"
                unfinished = stack.enter_context(once(folders[kind]))
                for task in options.tasks if unfinished else ():
                    assert unfinished is not None
                    store = options.out / "found" / before / f"{task}.db"
                    jobs += shown.jobs(store, task, kind, number, init, unfinished)
            if jobs:
                done = sum(side_by_side(jobs, options.workers, f"demonstrations for {before}"))
                print(f"{done} demonstrations for {before}", flush=True)
        return folders


def number_of(name: str) -> int:
    """The repetition of a policy."""
    return int(name.rpartition("-")[2])
