"""The runs of a comparison: what its store lacks is done, the rest is taken from there."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import NamedTuple

from vlafuzz.campaign.config import Plan, fuzz, make_executor, stands_alone
from vlafuzz.campaign.forecast import Forecast, Speed, usual_speed
from vlafuzz.campaign.resume import check_version
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model.conditions import ASKED, Origin, Role
from vlafuzz.rollouts.executor import Executor
from vlafuzz.store.records import UNFINISHED, Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import by_place, elsewhere

SpeedOf = Callable[[Plan], Speed | None]


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int

    def __str__(self) -> str:
        return f"{self.strategy}, seed {self.seed}"


def complete(
    store: Store,
    jobs: Sequence[Job],
    plan_of: Callable[[Job], Plan],
    wanted: Manifest,
    watch: Watch,
    speed_of: SpeedOf = usual_speed,
    triage: int = 0,
) -> list[Run]:
    """Begin or resume the runs that a store lacks, in order; all of them that have a trial. They share no outcomes.

    Adjacent runs of one seed differ in what searches alone, and share an executor.

    Args:
        wanted: what every run would have if it began now, but for strategy and seed; batches may differ, as they suit
            the strategy.
        speed_of: the speed of a plan's policy, for a forecast.
        triage: rollouts for triage of each run, afterwards.
    """
    before = {job: stored(store, replace(wanted, **job._asdict())) for job in jobs}
    missing = [job for job, run in before.items() if run is None or run.status in UNFINISHED]
    total, done, number = wanted.budget * len(missing), 0, 0  # rollouts, and runs
    for _, group in groupby(missing, key=lambda job: job.seed):
        with ExitStack() as stack:
            executor: Executor | None = None
            for job in group:
                number += 1
                show = partial(watch.progress, f"run {number} of {len(missing)}: {job}", total=total)
                show(done)
                plan = _resumed(store, plan_of(job), before[job], str(job), watch)
                if number == 1:
                    if plan.manifest.alone:
                        watch.note(stands_alone(plan.manifest.policy))
                    _foresee(plan, len(missing), triage, watch, speed_of(plan))
                executor = executor or stack.enter_context(closing(make_executor(plan)))
                summary = fuzz(plan, store, executor, partial(_report, show, done), alone=True)
                done += plan.manifest.budget
                _check_judged(summary)
                if summary.stopped:
                    watch.note(f"{job} stopped: {summary.stopped}")
    runs = (stored(store, replace(wanted, **job._asdict())) for job in jobs)
    tried = [run for run in runs if run and store.extent(run.id)[0]]
    note_places(tried, watch)
    return tried


def stored(store: Store, wanted: Manifest) -> Run | None:
    """The run that a store has of these conditions: the first finished one, else the newest unfinished one.

    UsageError if another version made a run.
    """
    same = [run for run in store.runs() if set(run.manifest.differences(wanted, origins=ASKED)) <= {"batch"}]
    for run in same:
        for name in run.manifest.differences(wanted, roles=set(Role) - {Role.PLACE}, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version than is installed: its {name} differs",
                hint="runs of two versions do not compare: give another --store",
            )
    finished = (run for run in same if run.status not in UNFINISHED)
    return next(finished, same[-1] if same else None)


def note_places(runs: Iterable[Run], watch: Watch) -> None:
    """Note it when runs that are compared were not all made at one place."""
    places = {run.id: run.manifest.place for run in runs}
    if len(set(places.values())) > 1:
        watch.note(
            f"note: the runs were made at several places ({by_place(places)}): shares of failures compare, "
            "outcomes of single scenes may not"
        )


def _report(show: Callable[[int], None], before: int, tally: Tally) -> None:
    show(before + tally.rollouts)


def _foresee(plan: Plan, runs: int, triage: int, watch: Watch, speed: Speed | None) -> None:
    """Say how long so many runs will take, of which the plan is the first."""
    if speed:
        rollouts, afterwards = runs * plan.manifest.budget, runs * triage
        seconds = Forecast(plan, speed, certify=False).rollout * (rollouts + afterwards)
        both = f"{rollouts} rollouts" + (f" and up to {afterwards} of triage" if afterwards else "")
        watch.note(f"{plural(runs, 'run')}, {both}: about {duration(seconds)}; {speed.words}")


def _resumed(store: Store, plan: Plan, run: Run | None, name: str, watch: Watch) -> Plan:
    """The plan, which resumes the stored run if there is one; that of another place begins anew."""
    if run is None:
        return plan
    if where := elsewhere(run.manifest.place, plan.manifest.place):
        watch.note(f"{name}: begins anew, since run {run.id} ended early {where}")
        return plan
    check_version(store.path, run, plan.manifest)
    return replace(plan, manifest=run.manifest, resume=run.id)


def _check_judged(summary: Summary) -> None:
    if summary.verdicts["error"] and summary.short and (summary.stopped or summary.unjudged):
        doctor = "`vlafuzz doctor` checks this machine, with --policy the policy"
        again = "then the same command goes on" if summary.stopped else "then use another store"
        raise PrerequisiteError(summary.short, hint=f"{doctor}; {again}")
    if summary.unjudged:
        why = f": {summary.stopped}" if summary.stopped else ""
        raise UsageError(
            f"{summary.unjudged}{why}", hint="`vlafuzz doctor` checks this machine; then use another store"
        )
