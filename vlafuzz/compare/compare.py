"""Compare strategies: do the runs that are missing, let the expert try a sample of failures, triage some."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.launch import WantedRun, do_missing, note_places, stored_run
from vlafuzz.compare.comparison import Comparison, compare_runs
from vlafuzz.compare.failures import CountedRun, count_run
from vlafuzz.compare.samples import Evidence, Sampled, Witnesses, choose, evidence, findings, sample, solvable
from vlafuzz.conditions.conditions import ASKED, Origin, Role
from vlafuzz.errors import UsageError
from vlafuzz.files import make_folder
from vlafuzz.store.records import UNFINISHED, Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.triage import scene_runner
from vlafuzz.triage.pipeline import triage
from vlafuzz.watch import SILENT, Watch

# Values that are too long for a message.
_SAID = {
    "operators_digest": "other operators, or other ranges",
    "packs": "other packs of objects",
    "scene_file": "another pool of scenes",
}
_ELSEWHERE = "give another --store for another comparison, or the flags of the runs in there"


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int


def jobs(strategies: Sequence[str], repeats: int, seed: int) -> list[Job]:
    """All runs, one of every strategy before the second of any: an interrupted comparison is balanced."""
    return [Job(name, seed + number) for number in range(repeats) for name in strategies]


def stored(path: Path, runs: Iterable[Run], here: Manifest, wanted: Sequence[Job]) -> dict[Job, Run]:
    """The runs of a comparison that a store has, finished or not. Other strategies and seeds are ignored.

    Args:
        here: the manifest of any of its runs, as it would be made now.

    Raises:
        UsageError: the store has runs under other conditions, or runs that cannot be resumed here.
    """
    by_job: dict[Job, list[Run]] = {}
    for run in runs:
        _check_alike(path, run, here)
        by_job.setdefault(Job(run.manifest.strategy, run.manifest.seed), []).append(run)
    known = {job: best for job in wanted if (best := stored_run(by_job.get(job, [])))}
    complete = len(known) == len(wanted) and all(run.status not in UNFINISHED for run in known.values())
    _check_versions(path, list(known.values()), None if complete else here)
    return known


def _check_alike(path: Path, run: Run, wanted: Manifest) -> None:
    for name in run.manifest.differences(wanted, origins=ASKED):
        if name in Job._fields:
            continue
        was, now = getattr(run.manifest, name), getattr(wanted, name)
        difference = _SAID.get(name, f"{name} {was}, not {now}")
        raise UsageError(f"{path}: run {run.id} has other conditions: {difference}", hint=_ELSEWHERE)


def _check_versions(path: Path, runs: Sequence[Run], here: Manifest | None) -> None:
    """That one version made all of them, wherever that was; with ``here`` that it is this one, too."""
    roles = set(Role) - {Role.PLACE}
    first = here or (runs[0].manifest if runs else None)
    for run in runs:
        for name in run.manifest.differences(first or run.manifest, roles=roles, origins=[Origin.HERE]):
            other = "is installed" if here else f"run {runs[0].id}"
            raise UsageError(
                f"{path}: run {run.id} was made by another version than {other}: its {name} differs",
                hint="runs of two versions do not compare: give another --store",
            )


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
        note_places(known.values(), watch)
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
