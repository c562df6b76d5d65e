"""Compare strategies: do the runs that a store lacks, triage their failures within a limit of rollouts, and count."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig, fuzz, make_executor, stands_alone
from vlafuzz.campaign.forecast import Forecast, Speed, usual_speed
from vlafuzz.campaign.resume import check_version
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.files import writing
from vlafuzz.common.statistics import Estimate, Share
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.triage.pipeline import HERE, Allowance, findings_in_order, job_of, runner_of_run, work
from vlafuzz.failures.triage.triager import Unjudged
from vlafuzz.lab.comparison import Comparison, Counted, compare_runs
from vlafuzz.model import Verdict
from vlafuzz.model.conditions import ASKED, Origin, Role
from vlafuzz.rollouts.crew import Make
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import UNFINISHED, Finding, Manifest, Run, Triaged, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.provenance import by_place, elsewhere

Known = dict[tuple[str, str], Triaged]  # results of triage by the finding's key
SpeedOf = Callable[[Plan], Speed | None]


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int

    def __str__(self) -> str:
        return f"{self.strategy}, seed {self.seed}"


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
        speed_of: see ``complete``.
    """
    assert run.store
    first = config.plan(run)

    def plan(job: Job) -> Plan:
        planned = config.plan(replace(run, strategy=job.strategy, seed=job.seed))
        # What is committed in the meantime does not change the code that is loaded.
        return replace(planned, manifest=replace(planned.manifest, commit=first.manifest.commit))

    # One of every strategy before the second of any: an interrupted comparison is balanced.
    jobs = [Job(name, run.seed + number) for number in range(repeats) for name in strategies]
    with writing(folder, "give --out another folder"):
        folder.mkdir(parents=True, exist_ok=True)
    with Store.open(run.store, "write") as store:
        runs = complete(store, jobs, plan, first.manifest, watch, speed_of, limit)
        trials = {done.id: _own_trials(store, done) for done in runs}
        if limit:
            _certify(store, runs, limit, first.triage_place, watch)
        known = known_results(store) if limit else None
        counted = [_count(store, done, trials[done.id], known, limit) for done in runs]
    return compare_runs(counted, strategies, first.manifest, store=str(run.store), limit=limit)


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


def _own_trials(store: Store, run: Run) -> list[Trial]:
    """The trials of a run.

    Raises:
        UsageError: it reused outcomes of other runs, so that its budget does not compare.
    """
    trials = list(store.trials(run.id))
    # A duplicate may precede the trial of its batch that was rolled out, so this waits for all of them.
    own = {trial.scene.digest for trial in trials if not trial.duplicate}
    if borrowed := len({trial.scene.digest for trial in trials} - own):
        raise UsageError(
            f"{store.path}: run {run.id} reused {borrowed} outcomes of other runs, at no cost",
            hint="compare only runs that `vlafuzz compare` did from start to end: give another --store",
        )
    return trials


def _count(store: Store, run: Run, trials: Sequence[Trial], known: Known | None, limit: int) -> Counted:
    """Count a stored run, with what its triage has come to."""
    verdicts = [trial.outcome.verdict for trial in trials]
    failed = verdicts.count(Verdict.FAILED)
    probability = None
    if found := store.causes(run.id):
        probability = found.probability and Estimate(*found.probability)
    elif run.manifest.strategy == "random" and (judged := failed + verdicts.count(Verdict.PASSED)):
        share = Share.of_counts(failed, judged)
        probability = Estimate(share.share, share.low, share.high)
    made = None if known is None else certified(findings_in_order(store, run.id), known, limit)
    return Counted(
        run=run.id,
        strategy=run.manifest.strategy,
        seed=run.manifest.seed,
        rollouts=store.rollouts(run.id),
        **(made._asdict() if made else {}),
        causes=len(made.signatures) if made else None,
        failures=len({trial.scene.digest for trial in trials if trial.outcome.verdict is Verdict.FAILED}),
        probability=probability,
    )


class Certified(NamedTuple):
    """Triage of a run's findings has come to this: the fields of ``Counted`` of the same names."""

    signatures: tuple[str, ...]
    triaged: int
    triage_rollouts: int


def certified(findings: Sequence[Finding], known: Known, limit: int) -> Certified:
    """Count the findings whose triage, one after the other, took no more rollouts than the limit.

    All of the limit counts as spent where it did not suffice for the next finding.
    """
    causes: dict[str, None] = {}
    triaged, spent = 0, 0
    for result in filter(None, (known.get(finding.key) for finding in findings)):
        spent += result.policy_rollouts
        if spent > limit:
            break
        triaged += 1
        if result.bucket == "minimal" and result.signature:
            causes[result.signature] = None
    return Certified(tuple(causes), triaged, min(spent, limit))


def _certify(store: Store, runs: Sequence[Run], limit: int, place: Place, watch: Watch) -> None:
    """Triage the failures of each run, as far as that was not done before."""
    left = [run for run in runs if _left(store, run, limit)[0]]
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


def _left(store: Store, run: Run, limit: int) -> tuple[list[Finding], Allowance]:
    """The findings of a run that are to be triaged, and what those before the first of them leave of the limit."""
    known, left, spent, allowance = known_results(store), list[Finding](), 0, Allowance(limit)
    for finding in findings_in_order(store, run.id):
        if spent >= limit:
            break
        if result := known.get(finding.key):
            spent += result.policy_rollouts
            allowance.spent += 0 if left else result.policy_rollouts
        else:
            left.append(finding)
    return left, allowance


def certify(
    store: Store,
    make: Make,
    runs: Sequence[Run],
    limit: int,
    place: Place = HERE,
    watch: Callable[[int, int], None] = lambda number, spent: None,
) -> int:
    """Triage the findings of every run, in order, until they have taken ``limit`` rollouts of the policy.

    Every result is stored at once; a finding of several runs is triaged once. Findings share no verdicts, so that
    results depend neither on the number of workers nor on interruptions.

    Args:
        watch: is told the index of a run, and the rollouts that its findings have taken so far.

    Returns:
        The number of findings that could not be judged: see ``pipeline.triage``.
    """
    unjudged = 0
    for index, run in enumerate(runs):
        left, allowance = _left(store, run, limit)
        watch(index, min(allowance.spent, limit))
        for result in work(make, [job_of(store, run, left)], place, allowance):
            if isinstance(result, Triaged):
                allowance.charge(result)
                store.settle(result)
            else:
                unjudged += result is not Unjudged.LATE
            watch(index, min(allowance.spent, limit))
    return unjudged


def known_results(store: Store) -> Known:
    return {triaged.key: triaged for triaged in store.triaged()}
