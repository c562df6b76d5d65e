"""Compare strategies: do the runs that are missing, let the expert try a sample of failures, triage some."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.launch import WantedRun, do_missing
from vlafuzz.compare.comparison import Comparison, compare_runs
from vlafuzz.compare.evidence import Evidence, choose, evidence, findings
from vlafuzz.compare.failures import CountedRun, count_run
from vlafuzz.compare.runs import Job, jobs, stored
from vlafuzz.compare.solvable import Sampled, Witnesses, sample, solvable
from vlafuzz.files import make_folder
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.triage import scene_runner
from vlafuzz.triage.pipeline import triage
from vlafuzz.watch import SILENT, Watch


class Sizes(NamedTuple):
    """How many failures of each strategy the expert tries, and how many of these are triaged."""

    tried: int
    triaged: int


def compare(
    run: RunConfig, strategies: Sequence[str], repeats: int, sizes: Sizes, folder: Path, watch: Watch = SILENT
) -> Comparison:
    """Compare strategies at equal budget; the first is the reference.

    Args:
        run: the same for all runs, but for strategy and seed; it names the store.
        folder: keeps what the expert solved.
    """
    assert run.store
    counted = _counted(run, strategies, repeats, folder, watch)
    sampled = {name: sample(runs, sizes.tried) for name, runs in counted.items()}
    solved = _solve(run.store, counted[strategies[0]][0].run.manifest, sampled, folder, watch)
    return compare_runs(
        counted,
        strategies[0],
        store=str(run.store),
        solvable={name: solvable(failures, solved) for name, failures in sampled.items()},
        evidence=_triage(run, sampled, solved, sizes.triaged, watch) if sizes.triaged else {},
    )


def _counted(
    run: RunConfig, strategies: Sequence[str], repeats: int, folder: Path, watch: Watch
) -> dict[str, list[CountedRun]]:
    """Do the runs that are missing; all runs, by strategy."""
    assert run.store
    first = config.plan(run)
    wanted = jobs(strategies, repeats, run.seed)
    if run.store.exists():  # checked before it is opened to write, which may upgrade it
        with Store.open(run.store) as store:
            stored(run.store, store.runs(), first.manifest, wanted)
    make_folder(folder)

    def plan(job: Job) -> Plan:
        planned = config.plan(replace(run, strategy=job.strategy, seed=job.seed))
        # What is committed in the meantime does not change the code that is loaded.
        return replace(planned, manifest=replace(planned.manifest, commit=first.manifest.commit))

    with Store.open(run.store, "write") as store:
        known = stored(run.store, store.runs(), first.manifest, wanted)
        runs = [
            WantedRun(
                name=f"{job.strategy}, seed {job.seed}",
                budget=first.manifest.budget,
                plan=partial(plan, job),
                stored=known.get(job),
                group=job.seed,  # the executor does not depend on the strategy
            )
            for job in wanted
        ]
        do_missing(store, runs, watch)
        known = stored(run.store, store.runs(), first.manifest, wanted)
        counted: dict[str, list[CountedRun]] = {name: [] for name in strategies}
        for job in wanted:
            counted[job.strategy].append(count_run(store, known[job], first.embed))
    return counted


def _solve(
    store: Path, manifest: Manifest, sampled: Mapping[str, Sequence[Sampled]], folder: Path, watch: Watch
) -> Mapping[str, bool]:
    """Whether the expert solves the sampled failures, by digest."""
    scenes = [failure.scene for failure in chain.from_iterable(sampled.values())]
    witnesses = Witnesses(folder / "witnesses.jsonl", manifest)
    if witnesses.missing(scenes):
        with closing(scene_runner.SimulatorSceneRunner(store, manifest)) as runner:
            witnesses.find(scenes, runner, partial(watch.progress, "failures tried by the expert"))
    return witnesses.solved


def _triage(
    run: RunConfig,
    sampled: Mapping[str, Sequence[Sampled]],
    solved: Mapping[str, bool],
    size: int,
    watch: Watch,
) -> dict[str, Evidence | None]:
    """Triage some of the sampled failures; the store keeps the results."""
    assert run.store
    with Store.open(run.store, "write") as store:
        chosen = {name: findings(store, choose(failures, solved, size)) for name, failures in sampled.items()}
        unjudged = triage(
            store,
            partial(scene_runner.runner_of_run, run.store, note=watch.note),
            findings=list(dict.fromkeys(chain.from_iterable(group.values() for group in chosen.values()))),
            workers=run.workers,
            watch=lambda now: watch.progress("sampled failures triaged", now.done, now.findings),
        )
        triaged = store.triaged()
    if unjudged:
        watch.note(
            f"{unjudged} of the sampled failures could not be judged: "
            "the policy broke, or they are no longer fair"
        )
    return {name: evidence(group, triaged) for name, group in chosen.items()}
