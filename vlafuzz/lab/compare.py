"""Compare strategies: do the runs that a store lacks, triage their failures within a limit of rollouts, and count."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig, fuzz, make_executor, stands_alone
from vlafuzz.campaign.forecast import Forecast, usual_speed
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.statistics import Estimate
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.triage.pipeline import HERE, Allowance, findings_in_order, job_of, runner_of_run, work
from vlafuzz.failures.triage.triager import Unjudged
from vlafuzz.lab.comparison import Comparison, Counted, compare_runs
from vlafuzz.model.conditions import ASKED, Origin
from vlafuzz.report.tables import rate_of
from vlafuzz.rollouts.crew import Make
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import UNFINISHED, Finding, Manifest, Run, Triaged
from vlafuzz.store.store import Store


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int

    def __str__(self) -> str:
        return f"{self.strategy}, seed {self.seed}"


def compare(run: RunConfig, strategies: Sequence[str], repeats: int, limit: int, watch: Watch = SILENT) -> Comparison:
    """Compare strategies at equal budget; the first is the reference.

    Args:
        run: the same for all runs, but for strategy and seed; it names the store.
        limit: policy rollouts to triage the failures of each run; 0 for no triage.
    """
    assert run.store
    first = config.plan(run)

    def plan(job: Job) -> Plan:
        planned = config.plan(replace(run, strategy=job.strategy, seed=job.seed))
        # What is committed in the meantime does not change the code that is loaded.
        return replace(planned, manifest=replace(planned.manifest, commit=first.manifest.commit))

    # One of every strategy before the second of any: an interrupted comparison is balanced.
    jobs = [Job(name, run.seed + number) for number in range(repeats) for name in strategies]
    with Store.open(run.store, "write") as store:
        runs = complete(store, jobs, plan, first.manifest, watch)
        for done in runs:
            _check_own(store, done)
        if limit:
            make = partial(runner_of_run, store.path, note=watch.note)
            certify(store, make, runs, limit, first.triage_place, watch)
        counted = [_count(store, done, limit) for done in runs]
    return compare_runs(counted, strategies, first.manifest, store=str(run.store), limit=limit)


def complete(
    store: Store, jobs: Sequence[Job], plan_of: Callable[[Job], Plan], wanted: Manifest, watch: Watch
) -> list[Run]:
    """Begin or resume the runs that a store lacks, in order; all of them that have a trial. They share no outcomes.

    Adjacent runs of one seed differ in what searches alone, and share an executor.

    Args:
        wanted: what every run would have if it began now, but for strategy and seed; batches may differ, as they suit
            the strategy.
    """
    before = {job: stored(store, replace(wanted, **job._asdict())) for job in jobs}
    missing = [job for job, run in before.items() if run is None or run.status in UNFINISHED]
    done, number = 0, 0  # rollouts, and runs
    for _, group in groupby(missing, key=lambda job: job.seed):
        with ExitStack() as stack:
            executor: Executor | None = None
            for job in group:
                number += 1
                total = wanted.budget * len(missing)
                show = partial(watch.progress, f"run {number} of {len(missing)}: {job}", total=total)
                show(done)
                plan = plan_of(job)
                if run := before[job]:
                    plan = replace(plan, manifest=run.manifest, resume=run.id)
                if number == 1 and plan.manifest.alone:
                    watch.note(stands_alone(plan.manifest.policy))
                if number == 1 and (speed := usual_speed(plan)):
                    seconds = total * Forecast(plan, speed, certify=False).rollout
                    about = plural(len(missing), "run")
                    watch.note(f"{about}: about {duration(seconds)} without triage; {speed.words}")
                executor = executor or stack.enter_context(closing(make_executor(plan)))
                summary = fuzz(plan, store, executor, partial(_report, show, done), alone=True)
                done += plan.manifest.budget
                _check_judged(summary)
                if summary.stopped:
                    watch.note(f"{job} stopped: {summary.stopped}")
    runs = (stored(store, replace(wanted, **job._asdict())) for job in jobs)
    return [run for run in runs if run and store.extent(run.id)[0]]


def stored(store: Store, wanted: Manifest) -> Run | None:
    """The run that a store has of these conditions: the first finished one, else the newest unfinished one.

    UsageError if another version made a run, or another machine.
    """
    same = [run for run in store.runs() if set(run.manifest.differences(wanted, origins=ASKED)) <= {"batch"}]
    for run in same:
        for name in run.manifest.differences(wanted, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version, or elsewhere: its {name} differs",
                hint="such runs do not compare: give another --store",
            )
    finished = (run for run in same if run.status not in UNFINISHED)
    return next(finished, same[-1] if same else None)


def _report(show: Callable[[int], None], before: int, tally: Tally) -> None:
    show(before + tally.rollouts)


def _check_judged(summary: Summary) -> None:
    """Raise an error where a run has judged nothing, or errors ended it."""
    if not (summary.unjudged or (summary.short and summary.stopped)):
        return
    errors = summary.verdicts["error"]
    again = "then the same command goes on" if errors and summary.stopped else "then use another store"
    why = f": {summary.stopped}" if summary.stopped and not errors else ""
    problem = PrerequisiteError if errors else UsageError
    hint = f"`vlafuzz doctor` checks this machine, with --policy the policy; {again}"
    raise problem(f"{summary.short}{why}", hint=hint)


def _check_own(store: Store, run: Run) -> None:
    """Raise a UsageError if a run reused outcomes of other runs, so that its budget does not compare."""
    trials = list(store.trials(run.id))
    # A duplicate may precede the trial of its batch that was rolled out, so this waits for all of them.
    own = {trial.scene.digest for trial in trials if not trial.duplicate}
    if borrowed := len({trial.scene.digest for trial in trials} - own):
        raise UsageError(
            f"{store.path}: run {run.id} reused {borrowed} outcomes of other runs, at no cost",
            hint="compare only runs that `vlafuzz compare` did from start to end: give another --store",
        )


def _count(store: Store, run: Run, limit: int) -> Counted:
    rate = rate_of(store, run, store.causes(run.id))
    made = certified(findings_in_order(store, run.id), store.triaged(), limit) if limit else None
    return Counted(
        run=run.id,
        strategy=run.manifest.strategy,
        seed=run.manifest.seed,
        rollouts=store.rollouts(run.id),
        triage_rollouts=made.rollouts if made else None,
        triaged=made.triaged if made else None,
        signatures=made.signatures if made else (),
        causes=len(made.signatures) if made else None,
        failures=store.judged([run.id])[0],
        probability=rate and Estimate(*rate),
    )


class Certified(NamedTuple):
    """Counts what triage of a run's findings, one after the other, has come to within a limit of rollouts.

    Attributes:
        signatures: the causes that it certified, of ``triaged`` findings.
        rollouts: all of the limit where it did not suffice for the next finding.
        left: the findings that are still to be triaged; ``before``: rollouts of those before the first of them.
    """

    signatures: tuple[str, ...]
    triaged: int
    rollouts: int
    left: tuple[Finding, ...] = ()
    before: int = 0


def certified(findings: Sequence[Finding], known: Iterable[Triaged], limit: int) -> Certified:
    """Count the findings whose triage took no more rollouts than the limit, and list those that are left."""
    results, causes, left = {row.key: row for row in known}, dict[str, None](), list[Finding]()
    triaged, spent, before = 0, 0, 0
    for finding in findings:
        if spent >= limit:
            break
        result = results.get(finding.key)
        if result is None:
            left.append(finding)
            continue
        spent += result.policy_rollouts
        before += 0 if left else result.policy_rollouts
        if spent <= limit:
            triaged += 1
            if result.bucket == "minimal" and result.signature:
                causes[result.signature] = None
    return Certified(tuple(causes), triaged, min(spent, limit), tuple(left), before if left else 0)


def certify(
    store: Store, make: Make, runs: Sequence[Run], limit: int, place: Place = HERE, watch: Watch = SILENT
) -> None:
    """Triage the findings of every run, in order, until they have taken ``limit`` rollouts of the policy.

    Every result is stored at once; a finding of several runs is triaged once. Findings share no verdicts, so that
    results depend neither on the number of workers nor on interruptions.
    """
    unjudged = 0
    for number, run in enumerate(runs):
        so_far = certified(findings_in_order(store, run.id), store.triaged(), limit)
        if not so_far.left:
            continue
        allowance = Allowance(limit, spent=so_far.before)
        doing = f"triage {number + 1} of {len(runs)}: {Job(run.manifest.strategy, run.manifest.seed)}"
        watch.progress(doing, number * limit, len(runs) * limit)
        for result in work(make, [job_of(store, run, so_far.left)], place, allowance):
            if isinstance(result, Triaged):
                allowance.charge(result)
                store.settle(result)
            else:
                unjudged += result is not Unjudged.LATE
            watch.progress(doing, number * limit + min(allowance.spent, limit), len(runs) * limit)
    if unjudged:
        watch.note(
            f"{plural(unjudged, 'failure')} could not be judged: the policy broke, or it is no longer fair\n"
            "hint: the same command tries them again"
        )
