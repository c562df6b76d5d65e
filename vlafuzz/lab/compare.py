"""Compare strategies: do the runs that are missing, triage their failures within a limit of rollouts, and count."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.common.files import writing
from vlafuzz.common.statistics import Estimate, Share
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.pipeline import HERE, Allowance, findings_in_order, job_of, runner_of_run, work
from vlafuzz.failures.triage.triager import Unjudged
from vlafuzz.lab.comparison import Comparison, Counted, compare_runs
from vlafuzz.lab.runs import Job, SpeedOf, complete
from vlafuzz.model import Verdict
from vlafuzz.rollouts.crew import Make
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import Finding, Run, Triaged, Trial
from vlafuzz.store.store import Store

Known = dict[tuple[str, str], Triaged]  # results of triage by the finding's key


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
