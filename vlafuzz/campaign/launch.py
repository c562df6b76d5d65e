"""Start the run of a plan, or all runs that a store lacks."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby

from vlafuzz.campaign import fuzz as campaign
from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.forecast import Forecast, Speed, usual_speed
from vlafuzz.campaign.resume import check_version
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError, StoreError, UsageError
from vlafuzz.rollouts.executor import Executor, Until
from vlafuzz.rollouts.registry import executor_at
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import UNFINISHED, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import by_place, elsewhere

SEARCH = 0.5  # share of the time for a run where triage follows, which takes about as many rollouts
SpeedOf = Callable[[Plan], Speed | None]


def start(plan: Plan, watch: Callable[[Tally], None], deadline: Deadline | None = None) -> Summary:
    """Run a plan; after the deadline no scene is begun, and the run can be resumed."""
    # The store first: it shows at once whether it can be written, while a simulator takes seconds to start.
    with Store.open(plan.store, "write") as store, closing(make_executor(plan)) as executor:
        return fuzz(plan, store, Until(executor, deadline) if deadline else executor, watch)


def fuzz(
    plan: Plan, store: Store, executor: Executor, watch: Callable[[Tally], None], *, alone: bool = False
) -> Summary:
    """Run a plan in an open store with an existing executor; see ``campaign.fuzz``."""
    return campaign.fuzz(
        manifest=plan.manifest,
        stages=plan.task.stage_names,
        space=plan.space,
        strategy=plan.strategy,
        executor=executor,
        store=store,
        patience=plan.patience,
        resume=plan.resume,
        alone=alone,
        watch=watch,
    )


def make_executor(plan: Plan) -> Executor:
    """The executor of a plan, with its evaluator."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.policy)


@dataclass(frozen=True, kw_only=True)
class WantedRun:
    """A run that a comparison or a study needs.

    Attributes:
        name: for progress messages.
        stored: the run that the store has of it, finished or not.
        group: adjacent runs of one group share an executor.
        policy: its name, where there are runs of several.
        triage: rollouts for triage of the run, afterwards.
    """

    name: str
    budget: int
    plan: Callable[[], Plan]
    stored: Run | None
    group: object
    policy: str | None = None
    triage: int = 0

    @property
    def missing(self) -> bool:
        return self.stored is None or self.stored.status in UNFINISHED


def stored_run(runs: Sequence[Run]) -> Run | None:
    """Of equal runs the first finished one, else the newest unfinished one."""
    finished = (run for run in runs if run.status not in UNFINISHED)
    return next(finished, runs[-1] if runs else None)


def do_missing(
    store: Store,
    wanted: Sequence[WantedRun],
    watch: Watch,
    left_out: Callable[[WantedRun, UsageError], None] | None = None,
    speed_of: SpeedOf = usual_speed,
) -> None:
    """Begin or resume the runs that are missing, in order. They share no outcomes.

    Args:
        left_out: is told of a run that cannot be done, or has only invalid scenes; else that is raised.
        speed_of: the speed of a plan's policy, for a forecast.
    """
    missing = [run for run in wanted if run.missing]
    alone, foreseen = set[str](), set[str | None]()
    total, before = sum(run.budget for run in missing), 0  # rollouts
    for _, group in groupby(enumerate(missing, start=1), key=lambda numbered: numbered[1].group):
        with ExitStack() as stack:
            executor: Executor | None = None
            for number, run in group:
                show = partial(watch.progress, f"run {number} of {len(missing)}: {run.name}", total=total)
                show(before)
                try:
                    plan = _plan(run, store, watch)
                    if plan.manifest.alone and plan.manifest.policy not in alone:
                        alone.add(plan.manifest.policy)
                        watch.note(stands_alone(plan.manifest.policy))
                    if run.policy not in foreseen:
                        foreseen.add(run.policy)
                        _foresee(plan, [one for one in missing if one.policy == run.policy], watch, speed_of(plan))
                    executor = executor or stack.enter_context(closing(make_executor(plan)))
                    summary = fuzz(plan, store, executor, partial(_report, show, before), alone=True)
                except StoreError:
                    raise
                except UsageError as error:
                    if left_out is None:
                        raise
                    left_out(run, error)
                    continue
                finally:
                    before += run.budget
                _check_judged(summary, may_be_empty=left_out is not None)
                if summary.stopped:
                    watch.note(f"{run.name} stopped: {summary.stopped}")


def _report(show: Callable[[int], None], before: int, tally: Tally) -> None:
    show(before + tally.rollouts)


def _foresee(plan: Plan, runs: Sequence[WantedRun], watch: Watch, speed: Speed | None) -> None:
    """Say how long the runs of a policy will take, of which the plan is the first."""
    if speed:
        rollouts, triage = sum(one.budget for one in runs), sum(one.triage for one in runs)
        seconds = Forecast(plan, speed, certify=False).rollout * (rollouts + triage)
        both = f"{rollouts} rollouts" + (f" and up to {triage} of triage" if triage else "")
        watch.note(f"{plural(len(runs), 'run')}, {both}: about {duration(seconds)}; {speed.words}")


def stands_alone(policy: str) -> str:
    """Why no stored outcome answers for a policy whose model nobody names, as a note."""
    return (
        f"note: {policy}: nothing says which model that is, so no stored outcome answers, and none of this "
        "run will later; ?version=NAME in the policy's name, or --label NAME of `run`, says which it is"
    )


def note_places(runs: Iterable[Run], watch: Watch) -> None:
    """Note it when runs that are compared were not all made at one place."""
    places = {run.id: run.manifest.place for run in runs}
    if len(set(places.values())) > 1:
        watch.note(
            f"note: the runs were made at several places ({by_place(places)}): shares of failures compare, "
            "outcomes of single scenes may not"
        )


def _plan(run: WantedRun, store: Store, watch: Watch) -> Plan:
    """The plan that begins a run, or resumes the stored one; that of another place begins anew."""
    plan = run.plan()
    if run.stored is None:
        return plan
    if where := elsewhere(run.stored.manifest.place, plan.manifest.place):
        watch.note(f"{run.name}: begins anew, since run {run.stored.id} ended early {where}")
        return plan
    check_version(store.path, run.stored, plan.manifest)
    return replace(plan, manifest=run.stored.manifest, resume=run.stored.id)


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
