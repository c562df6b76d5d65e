"""The runs of a comparison or a study: what its store lacks is done, the rest is taken from there."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TypeVar

from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.forecast import Forecast, Speed, usual_speed
from vlafuzz.campaign.launch import fuzz, make_executor, stands_alone
from vlafuzz.campaign.resume import check_version
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError
from vlafuzz.model.conditions import ASKED, Origin, Role
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.executor import Executor
from vlafuzz.store.records import UNFINISHED, Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import by_place, elsewhere

Key = TypeVar("Key", bound=Hashable)
SpeedOf = Callable[[Plan], Speed | None]


@dataclass(frozen=True)
class Wanted:
    """A run that is needed.

    Attributes:
        manifest: as the run would have it if it began now; batches may differ, as they suit the strategy.
        scenes: that the run has in this order, where they are given.
    """

    manifest: Manifest
    plan: Callable[[], Plan]
    scenes: Sequence[Scene] = ()


def complete(
    store: Store,
    wanted: Mapping[Key, Wanted],
    watch: Watch,
    speed_of: SpeedOf = usual_speed,
    *,
    flag: str,
    triage: int = 0,
    left_out: Callable[[Key, UsageError], None] | None = None,
) -> dict[Key, Run]:
    """Begin or resume the runs that a store lacks, in order; all of them that have a trial. They share no outcomes.

    Adjacent runs that differ in what searches alone share an executor.

    Args:
        speed_of: the speed of a plan's policy, for a forecast.
        flag: the option that names another place for the runs of another version.
        triage: rollouts for triage of each run, afterwards.
        left_out: is told of a run that cannot be done, or has only invalid scenes; else that is raised.
    """
    before = {key: stored(store, one.manifest, flag, one.scenes) for key, one in wanted.items()}
    missing = {key: one for key, one in wanted.items() if (run := before[key]) is None or run.status in UNFINISHED}
    alone, foreseen, number = set[str](), set[str](), 0
    total, done = sum(one.manifest.budget for one in missing.values()), 0  # rollouts
    for _, group in groupby(missing, key=lambda key: replace(missing[key].manifest, strategy="", batch=0)):
        with ExitStack() as stack:
            executor: Executor | None = None
            for key in group:
                number += 1
                show = partial(watch.progress, f"run {number} of {len(missing)}: {key}", total=total)
                show(done)
                try:
                    plan = _resumed(store, missing[key].plan(), before[key], str(key), watch)
                    policy = plan.manifest.policy
                    if plan.manifest.alone and policy not in alone:
                        alone.add(policy)
                        watch.note(stands_alone(policy))
                    if policy not in foreseen:
                        foreseen.add(policy)
                        budgets = [one.manifest.budget for one in missing.values() if one.manifest.policy == policy]
                        _foresee(plan, budgets, triage, watch, speed_of(plan))
                    executor = executor or stack.enter_context(closing(make_executor(plan)))
                    summary = fuzz(plan, store, executor, partial(_report, show, done), alone=True)
                except StoreError:
                    raise
                except UsageError as error:
                    if left_out is None:
                        raise
                    left_out(key, error)
                    continue
                finally:
                    done += missing[key].manifest.budget
                _check_judged(summary, may_be_empty=left_out is not None)
                if summary.stopped:
                    watch.note(f"{key} stopped: {summary.stopped}")
    runs = {key: stored(store, one.manifest, flag, one.scenes) for key, one in wanted.items()}
    tried = {key: run for key, run in runs.items() if run and store.count(run.id)}
    note_places(tried.values(), watch)
    return tried


def stored(store: Store, wanted: Manifest, flag: str, scenes: Sequence[Scene] = ()) -> Run | None:
    """The run that a store has of these conditions: the first finished one, else the newest unfinished one.

    With scenes, it has these or the first of them. UsageError if another version made a run.
    """
    same = [
        run
        for run in store.runs()
        if set(run.manifest.differences(wanted, origins=ASKED)) <= {"batch"}
        and (not scenes or all(trial.scene == scenes[trial.proposal] for trial in store.trials(run.id)))
    ]
    for run in same:
        for name in run.manifest.differences(wanted, roles=set(Role) - {Role.PLACE}, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version than is installed: its {name} differs",
                hint=f"runs of two versions do not compare: give another {flag}",
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


def _foresee(plan: Plan, budgets: Sequence[int], triage: int, watch: Watch, speed: Speed | None) -> None:
    """Say how long the runs of a policy will take, of which the plan is the first."""
    if speed:
        rollouts, afterwards = sum(budgets), triage * len(budgets)
        seconds = Forecast(plan, speed, certify=False).rollout * (rollouts + afterwards)
        both = f"{rollouts} rollouts" + (f" and up to {afterwards} of triage" if afterwards else "")
        watch.note(f"{plural(len(budgets), 'run')}, {both}: about {duration(seconds)}; {speed.words}")


def _resumed(store: Store, plan: Plan, run: Run | None, name: str, watch: Watch) -> Plan:
    """The plan, which resumes the stored run if there is one; that of another place begins anew."""
    if run is None:
        return plan
    if where := elsewhere(run.manifest.place, plan.manifest.place):
        watch.note(f"{name}: begins anew, since run {run.id} ended early {where}")
        return plan
    check_version(store.path, run, plan.manifest)
    return replace(plan, manifest=run.manifest, resume=run.id)


def _check_judged(summary: Summary, *, may_be_empty: bool) -> None:
    if summary.verdicts["error"] and summary.short and (summary.stopped or summary.unjudged):
        doctor = "`vlafuzz doctor` checks this machine, with --policy the policy"
        again = "then the same command goes on" if summary.stopped else "then use another store"
        raise PrerequisiteError(summary.short, hint=f"{doctor}; {again}")
    if summary.unjudged and not may_be_empty:
        why = f": {summary.stopped}" if summary.stopped else ""
        raise UsageError(
            f"{summary.unjudged}{why}", hint="`vlafuzz doctor` checks this machine; then use another store"
        )
