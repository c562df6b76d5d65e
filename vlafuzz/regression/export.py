"""export: the minimal findings of a store as a corpus, with controls. Each finding is checked once more."""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from typing import NamedTuple, Protocol

from vlafuzz.conditions import provenance
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.evidence import Witness
from vlafuzz.outcome import Verdict
from vlafuzz.regression.controls import CONTROLS, record
from vlafuzz.regression.corpus import Case, Control, Corpus, Evidence
from vlafuzz.scene import Scene
from vlafuzz.statistics import Share
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.oracle import Answer
from vlafuzz.triage.path import nominal
from vlafuzz.triage.summary import summarise
from vlafuzz.triage.triager import SceneRunner, repeat
from vlafuzz.watch import SILENT, Watch

FIRST = 1_000_000  # number of the first rollout: far from those of triage
FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


class PictureRunner(SceneRunner, Protocol):
    """A scene runner that also takes pictures.

    Attributes:
        renderer: what renders the policy's images; None for a policy without cameras.
    """

    renderer: str | None

    def picture(self, scene: Scene) -> bytes | None:
        """PNG of a scene; None where nothing can be rendered."""


class _Chosen(NamedTuple):
    finding: Finding
    triaged: Triaged
    shrunk: Scene
    witness: Witness


def export(
    store: Store,
    runner: Callable[[Run], PictureRunner],
    *,
    name: str,
    run: int | None = None,
    controls: int = CONTROLS,
    watch: Watch = SILENT,
) -> Corpus:
    """The minimal findings of a store that still hold, one case per scene, and the policy's controls.

    A finding holds if the policy fails no later than it did, passes in every counterpart, and a replay of the
    witness solves the scene.

    Args:
        runner: makes the scene runner that checks the findings of a run.
        run: only findings that this run found first.
        controls: number of random scenes in which the policy is rolled out as a baseline for ``regress``.

    Raises:
        UsageError: the store has several tasks or policies.
        StoreError: the store has no minimal finding, or none that holds.
    """
    chosen = _choose(store, run)
    runs = {begun.id: begun for begun in store.runs()}
    numbers = sorted({choice.finding.run for choice in chosen})
    _check_alike(store, [runs[number] for number in numbers])
    cases: list[Case] = []
    recorded: list[Control] = []
    left_out: Counter[str] = Counter()
    renderer, done = None, 0
    checked = partial(watch.progress, "minimal findings checked")
    checked(0, len(chosen))
    for number, group in groupby(chosen, lambda choice: choice.finding.run):
        with closing(runner(runs[number])) as checker:
            renderer = checker.renderer
            for choice in group:
                case = _case(choice, numbers.index(number), checker)
                if isinstance(case, Case):
                    cases.append(case)
                else:
                    left_out[case] += 1
                done += 1
                checked(done, len(chosen))
            if number == numbers[0]:
                recorded = record(checker, runs[number].manifest.seed, controls, watch)
    if not cases:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in left_out.items())
        problem = f"{store.path}: no minimal finding holds: {reasons}"
        raise StoreError(problem, hint="`vlafuzz triage` it here")
    return Corpus(
        name=name,
        runs=[runs[number].manifest for number in numbers],
        cases=cases,
        controls=recorded,
        evidence=_evidence(store, left_out),
        renderer=renderer,
        versions=provenance.versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _choose(store: Store, run: int | None) -> list[_Chosen]:
    """The minimal findings, ordered by run; of several with the same minimal scene, the first."""
    findings = {finding.key: finding for finding in store.findings(run)}
    chosen: dict[Scene, _Chosen] = {}
    for triaged in store.triaged():
        finding = findings.get(triaged.key)
        if finding and triaged.bucket == "minimal" and triaged.shrunk and triaged.witness:
            choice = _Chosen(finding, triaged, triaged.shrunk, triaged.witness)
            chosen.setdefault(choice.shrunk, choice)
    if not chosen:
        raise StoreError(f"{store.path}: has no minimal finding", hint="`vlafuzz triage` makes them")
    return sorted(chosen.values(), key=lambda choice: choice.finding.run)


def _check_alike(store: Store, runs: Sequence[Run]) -> None:
    kinds = {f"{run.manifest.policy} on {run.manifest.task}" for run in runs}
    if len(kinds) > 1:
        problem = f"has findings of {', '.join(sorted(kinds))}; a corpus has one policy and task"
        raise UsageError(f"{store.path}: {problem}", hint="--run N exports the findings of one run")


def _case(chosen: _Chosen, run: int, runner: PictureRunner) -> Case | str:
    """A finding as a case, or the reason why it no longer holds."""
    scene, triaged = chosen.shrunk, chosen.triaged
    lost = triaged.lost_stage
    runner.renew()
    answer, rate, loses = repeat(runner, scene, FIRST)
    if answer is not Answer.FAILS or loses is None or lost is None:
        return FLAKY
    if runner.stages.index(loses) > runner.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(runner, counterpart, FIRST)[0] is not Answer.PASSES:
            return f"without {operator} it no longer passes"
    replayed = runner.play(scene, chosen.witness.actions)
    if replayed.verdict is not Verdict.PASSED:
        return UNSOLVED
    control = nominal(runner.space, scene)
    return Case(
        scene=scene,
        lost_stage=loses,
        signature=triaged.signature or "",
        operators=triaged.operators,
        causes=triaged.causes,
        counterparts=triaged.counterparts,
        nominal=control,
        nominal_passes=repeat(runner, control, FIRST)[0] is Answer.PASSES,
        witness=replace(chosen.witness, states_hash=replayed.rollouts[0].states_hash),
        found=triaged.scene.digest,
        run=run,
        repeats=rate.rollouts,
        failures=rate.failures,
        rollouts=triaged.shrink_rollouts,
        certified=triaged.certified,
        counterpart_rates=triaged.counterpart_rates,
        thumbnail=runner.picture(scene),
    )


def _evidence(store: Store, left_out: Counter[str]) -> Evidence:
    summary = summarise(store)
    counts = {"confirmed": summary.confirmed, "witnessed": summary.witnessed, "by sight": summary.by_sight}
    counts |= {bucket: summary.buckets[bucket] for bucket in ("minimal", "base", "unproven", "edge", "flaky")}
    trials = (trial for run in store.runs() for trial in store.trials(run.id))
    return Evidence(
        findings=summary.findings,
        shares={name: Share.of_counts(count, summary.triaged) for name, count in counts.items()},
        left_out=dict(left_out),
        search_rollouts=sum(len(trial.outcome.rollouts) for trial in trials),
        triage_rollouts=summary.policy_rollouts,
        expert_rollouts=summary.expert_rollouts,
        seconds=summary.seconds,
    )
