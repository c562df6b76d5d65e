"""Compare strategies: do the runs that are missing, triage their failures, and count."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.campaign.launch import SpeedOf, WantedRun, do_missing, note_places, stored_run
from vlafuzz.common.files import make_folder
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.jobs import runner_of_run
from vlafuzz.lab.compare.certified import certify, uncertified
from vlafuzz.lab.compare.comparison import Comparison, compare_runs
from vlafuzz.lab.compare.figures import count_run, with_causes
from vlafuzz.lab.versions import check_one_version
from vlafuzz.model.conditions import ASKED
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import UNFINISHED, Manifest, Run
from vlafuzz.store.store import Store

# Values that are too long for a message.
_SAID = {
    "operators_digest": "other operators, or other ranges",
    "packs": "other packs of objects",
    "scene_file": "another pool of scenes",
    "label": "it may be of another model, since the policy's name has no version=",
}
_ELSEWHERE = "give another --store for another comparison, or the flags of the runs in there"


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int

    def __str__(self) -> str:
        return f"{self.strategy}, seed {self.seed}"


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
        for name in run.manifest.differences(here, origins=ASKED):
            if name in (*Job._fields, "batch"):  # the batch is as suits a strategy
                continue
            was, now = run.manifest.value(name), here.value(name)
            difference = _SAID.get(name, f"{name} {was}, not {now}")
            raise UsageError(f"{path}: run {run.id} has other conditions: {difference}", hint=_ELSEWHERE)
        by_job.setdefault(Job(run.manifest.strategy, run.manifest.seed), []).append(run)
    known = {job: best for job in wanted if (best := stored_run(by_job.get(job, [])))}
    complete = len(known) == len(wanted) and all(run.status not in UNFINISHED for run in known.values())
    check_one_version(path, list(known.values()), None if complete else here, "--store")
    return known


def compare(
    run: RunConfig,
    strategies: Sequence[str],
    repeats: int,
    limit: int,
    folder: Path,
    watch: Watch = SILENT,
    speed_of: SpeedOf = usual_speed,
) -> Comparison:
    """Compare strategies at equal budget; the first is the reference.

    Args:
        run: the same for all runs, but for strategy and seed; it names the store.
        limit: policy rollouts to triage the failures of each run; 0 for no triage.
        folder: for the results; made before the runs.
        speed_of: see ``do_missing``.
    """
    assert run.store
    first = config.plan(run)
    wanted = jobs(strategies, repeats, run.seed)
    if run.store.exists():  # checked before it is opened to write, which may upgrade it
        with Store.open(run.store) as store:
            stored(run.store, store.runs(), first.manifest, wanted)
    make_folder(folder)
    with Store.open(run.store, "write") as store:
        known = stored(run.store, store.runs(), first.manifest, wanted)
        do_missing(store, _wanted(run, first.manifest, wanted, known, limit), watch, speed_of=speed_of)
        runs = list(stored(run.store, store.runs(), first.manifest, wanted).values())
        note_places(runs, watch)
        counted = [count_run(store, done, first.embed) for done in runs]
        if limit:
            _certify(store, runs, limit, first.triage_place, watch)
        counted = with_causes(store, counted, limit)
    by_strategy = {name: [one for one in counted if one.run.manifest.strategy == name] for name in strategies}
    return compare_runs(by_strategy, strategies[0], store=str(run.store), limit=limit)


def _wanted(
    run: RunConfig, manifest: Manifest, jobs: Sequence[Job], known: Mapping[Job, Run], limit: int
) -> list[WantedRun]:
    def plan(job: Job) -> Plan:
        planned = config.plan(replace(run, strategy=job.strategy, seed=job.seed))
        # What is committed in the meantime does not change the code that is loaded.
        return replace(planned, manifest=replace(planned.manifest, commit=manifest.commit))

    return [
        WantedRun(
            name=str(job),
            budget=manifest.budget,
            plan=partial(plan, job),
            stored=known.get(job),
            group=job.seed,  # the executor does not depend on the strategy
            triage=limit,
        )
        for job in jobs
    ]


def _certify(store: Store, runs: Sequence[Run], limit: int, place: Place, watch: Watch) -> None:
    """Triage the failures of each run, as far as that was not done before."""
    left = uncertified(store, runs, limit)
    if not left:
        return
    most = len(left) * limit
    seconds, budgets = sum(run.seconds or 0.0 for run in runs), sum(run.manifest.budget for run in runs)
    took = f"about {duration(most * seconds / budgets)} at the speed of the runs"
    watch.note(f"triage of {plural(len(left), 'run')}, {most} rollouts: {took}")

    def progress(index: int, spent: int) -> None:
        name = Job(left[index].manifest.strategy, left[index].manifest.seed)
        watch.progress(f"triage {index + 1} of {len(left)}: {name}", index * limit + spent, most)

    make = partial(runner_of_run, store.path, note=watch.note)
    if unjudged := certify(store, make, left, limit, place, progress):
        watch.note(
            f"{plural(unjudged, 'failure')} could not be judged: the policy broke, or it is no longer fair\n"
            "hint: the same command tries them again"
        )
