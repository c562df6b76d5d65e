"""Compare strategies: do the runs that are missing, triage their failures, and count."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from vlafuzz.campaign import config
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.common.files import make_folder
from vlafuzz.common.statistics import Estimate, Share
from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.jobs import runner_of_run
from vlafuzz.failures.triage.pipeline import findings_in_order
from vlafuzz.lab.certified import Known, certified, certify, known_results, uncertified
from vlafuzz.lab.comparison import Comparison, Counted, compare_runs
from vlafuzz.lab.runs import Job, SpeedOf, complete
from vlafuzz.model.outcome import Verdict
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store


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
    make_folder(folder)
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
        rollouts=sum(len(trial.outcome.rollouts) for trial in trials if not trial.duplicate),
        triage_rollouts=made.rollouts if made else None,
        triaged=made.triaged if made else None,
        signatures=made.causes if made else (),
        causes=len(made.causes) if made else None,
        failures=len({trial.scene.digest for trial in trials if trial.outcome.verdict is Verdict.FAILED}),
        probability=probability,
    )


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
