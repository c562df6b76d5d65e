"""export: the minimal findings of a store as a corpus, with controls. Each finding is checked once more."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import partial
from itertools import count, groupby
from operator import itemgetter

from vlafuzz.common.text import duration, plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import PrerequisiteError, StoreError
from vlafuzz.failures.corpus.controls import CONTROLS, EXPORT, MILDER, record
from vlafuzz.failures.corpus.corpus import Case, Control, Corpus, Evidence
from vlafuzz.failures.corpus.sign_test import power_of
from vlafuzz.failures.triage.oracle import Answer
from vlafuzz.failures.triage.pipeline import pace, summarise
from vlafuzz.failures.triage.triager import repeat
from vlafuzz.model import Failure, Scene, Verdict
from vlafuzz.rollouts.crew import Make, crew_at
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store
from vlafuzz.worlds import provenance

PER_CASE = 20  # rollouts in a minimal scene and its counterparts, about
# Why a finding is left out.
SAME = "its scene is that of another finding"
UNJUDGED = "the policy or the simulator broke"
FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"
OTHER = "it is of another policy or task than the newest run"


def export(
    store: Store,
    runner: Make,
    *,
    name: str,
    run: int | None = None,
    task: str | None = None,
    controls: int = CONTROLS,
    workers: int = 1,
    watch: Watch = SILENT,
) -> Corpus:
    """The minimal findings of the newest run's policy that still hold, one case per scene, and its controls.

    A finding holds if the policy fails no later than it did, passes in every counterpart, and a replay of the witness
    solves the scene.

    Args:
        runner: makes the scene runner that checks the findings of a run.
        run: only findings that this run found first; ``task``: only those of one task.
        controls: number of random scenes in which the policy is rolled out as a baseline for ``regress``; more where it
            passes rarely, see ``record``.
        workers: processes that share the rollouts; ``runner`` is picklable where there are several.

    Raises:
        StoreError: the store has no minimal finding, or none that holds.
        PrerequisiteError: the policy passes in so few controls that there could be no alarm.
    """
    found = _choose(store, run, task)
    runs = {begun.id: begun for begun in store.runs()}
    kinds = {number: (runs[number].manifest.tested, runs[number].manifest.task) for number, _ in found}
    chosen = [one for one in found if kinds[one[0]] == kinds[max(kinds)]]
    numbers = sorted({number for number, _ in chosen})
    cases: dict[Scene, Case] = {}
    recorded: list[Control] = []
    takes = duration((controls + PER_CASE * len(chosen)) * pace(store, workers))
    watch.note(f"{plural(len(chosen), 'minimal finding')} and {controls} controls: about {takes}")
    left_out = Counter({OTHER: len(found) - len(chosen)} if len(chosen) < len(found) else {})
    checked = partial(watch.progress, "minimal findings checked", total=len(chosen))
    done = count(1)
    checked(0)
    for number, group in groupby(chosen, itemgetter(0)):
        findings = [triaged for _, triaged in group]
        results: dict[int, Case | str] = {}
        manifest = runs[number].manifest
        with crew_at(Place(workers), partial(runner, runs[number]), manifest.policy) as crew:
            checker = crew.runner
            if number == numbers[0]:
                renderer = checker.renderer
                ((_, recorded),) = crew.each(partial(record, checker, manifest.seed, watch=watch), [controls])
                _check_power(recorded, watch)
            one = partial(_check, run=numbers.index(number), runner=checker)
            for index, result in crew.each(one, findings):
                results[index] = result
                checked(next(done))
        for _, case in sorted(results.items()):
            if not isinstance(case, Case):
                left_out[case] += 1
            elif cases.setdefault(case.scene, case) is not case:
                left_out[SAME] += 1
    if not cases:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in left_out.items())
        problem = f"{store.path}: no minimal finding holds: {reasons}"
        raise StoreError(problem, hint="`vlafuzz triage` it here")
    took = summarise(store, task)
    return Corpus(
        name=name,
        runs=[runs[number].manifest for number in numbers],
        cases=list(cases.values()),
        controls=recorded,
        evidence=Evidence(
            left_out=dict(left_out),
            search_rollouts=sum(store.rollouts(run.id) for run in runs.values() if task in (None, run.manifest.task)),
            triage_rollouts=took.policy_rollouts,
            expert_rollouts=took.expert_rollouts,
        ),
        renderer=renderer,
        versions=provenance.versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _check(triaged: Triaged, run: int, runner: SceneRunner) -> Case | str:
    """A minimal finding as a case, or the reason why it does not hold.

    Args:
        run: number of the finding's run in the corpus.
    """
    scene, lost, witness = triaged.shrunk, triaged.lost_stage, triaged.witness
    assert scene is not None
    assert lost is not None
    assert witness is not None
    answer, rate, loses = repeat(runner, scene, EXPORT)
    if answer is Answer.BROKEN:
        return UNJUDGED
    if answer is not Answer.FAILS or loses is None:
        return FLAKY
    if runner.stages.index(loses) > runner.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(runner, counterpart, EXPORT)[0] is not Answer.PASSES:
            return f"without {operator} it no longer passes"
    replayed = runner.play(scene, witness.actions)
    if replayed.verdict is not Verdict.PASSED:
        return UNSOLVED
    control = runner.space.nominal(like=scene)
    known = {part.name: getattr(triaged, part.name) for part in fields(Failure)}
    rates = {name: rate for name, rate in triaged.counterpart_rates.items() if name in triaged.counterparts}
    anew = {"lost_stage": loses, "repeats": rate.rollouts, "failures": rate.failures, "counterpart_rates": rates}
    return Case(
        **known | anew,
        scene=scene,
        counterparts=triaged.counterparts,
        reference=triaged.reference,
        nominal=control,
        nominal_passes=repeat(runner, control, EXPORT)[0] is Answer.PASSES,
        witness=replace(witness, states_hash=replayed.rollouts[0].states_hash),
        found=triaged.scene.digest,
        run=run,
        rollouts=triaged.shrink_rollouts,
    )


def _check_power(controls: Sequence[Control], watch: Watch) -> None:
    """Say what loss the controls could notice, before the findings are checked."""
    if not controls:
        return
    power = power_of([control.passed for control in controls])
    if not power.possible:
        raise PrerequisiteError(str(power), hint=f"{MILDER}; --controls 0 writes a corpus without an alarm")
    watch.note(f"{power}; {MILDER}" if power.total else str(power))


def tasks_of(store: Store, run: int | None) -> list[str]:
    """The tasks of the minimal findings; a StoreError if there is none."""
    return list(dict.fromkeys(triaged.scene.task for _, triaged in _choose(store, run)))


def _choose(store: Store, run: int | None, task: str | None = None) -> list[tuple[int, Triaged]]:
    """The minimal findings with their runs, ordered by these; of several with one minimal scene the first."""
    runs = {finding.key: finding.run for finding in store.findings(run)}
    chosen: dict[Scene, tuple[int, Triaged]] = {}
    for triaged in store.triaged():
        if task not in (None, triaged.scene.task):
            continue
        if triaged.key in runs and triaged.bucket == "minimal" and triaged.shrunk and triaged.witness:
            chosen.setdefault(triaged.shrunk, (runs[triaged.key], triaged))
    if not chosen:
        raise StoreError(f"{store.path}: has no minimal finding", hint="`vlafuzz triage` makes them")
    return sorted(chosen.values(), key=itemgetter(0))
