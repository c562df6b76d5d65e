"""export: the minimal findings of a store as a corpus, with controls. Each finding is checked once more."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from typing import NamedTuple, Protocol

from vlafuzz.conditions import provenance
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.evidence import Witness
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.controls import CONTROLS, EXPORT, record
from vlafuzz.regression.corpus import Case, Control, Corpus, Evidence
from vlafuzz.scene import Scene
from vlafuzz.space.jitter import load_jitter
from vlafuzz.statistics import Share
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.oracle import MOST, Answer
from vlafuzz.triage.path import nominal
from vlafuzz.triage.pool import PooledRunner, process_pool
from vlafuzz.triage.summary import summarise
from vlafuzz.triage.triager import SceneRunner, repeat
from vlafuzz.watch import SILENT, Watch

ROLLOUTS = 20  # in the neighbourhood of a scene, where a share of them has to hold
FLAKY = "it no longer fails"
UNJUDGED = "the policy or the simulator broke"
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
    firm: float | None = None,
    workers: int = 1,
    watch: Watch = SILENT,
) -> Corpus:
    """The minimal findings of a store that still hold, one case per scene, and the policy's controls.

    A finding holds if the policy fails no later than it did, passes in every counterpart, and a replay of the
    witness solves the scene.

    Args:
        runner: makes the scene runner that checks the findings of a run.
        run: only findings that this run found first.
        controls: number of random scenes in which the policy is rolled out as a baseline for ``regress``.
        firm: share of jittered rollouts that have to fail in a scene, and to pass in its counterparts; by
            default most, and each is repeated until that is clear.
        workers: processes that share the rollouts; ``runner`` is picklable where there are several.

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
        with _checker(runner, runs[number], workers) as checker:
            renderer = checker.renderer
            for choice in group:
                case = _case(choice, numbers.index(number), checker, firm)
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


@contextmanager
def _checker(make: Callable[[Run], PictureRunner], run: Run, workers: int) -> Iterator[PictureRunner]:
    if workers == 1:
        with closing(make(run)) as runner:
            yield runner
    else:
        with process_pool(workers) as pool:
            yield PooledRunner(pool, make, run)


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


def _case(chosen: _Chosen, run: int, runner: PictureRunner, firm: float | None) -> Case | str:
    """A finding as a case, or the reason why it no longer holds."""
    scene, triaged = chosen.shrunk, chosen.triaged
    lost = triaged.lost_stage
    runner.renew()
    answer, rate, loses = repeat(runner, scene, EXPORT)
    if answer is Answer.BROKEN:
        return UNJUDGED
    if answer is not Answer.FAILS or loses is None or lost is None:
        return FLAKY
    if runner.stages.index(loses) > runner.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(runner, counterpart, EXPORT)[0] is not Answer.PASSES:
            return f"without {operator} it no longer passes"
    if firm is not None and (problem := _not_firm(triaged, runner, firm)):
        return problem
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
        reference=triaged.reference,
        nominal_passes=repeat(runner, control, EXPORT)[0] is Answer.PASSES,
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


def _not_firm(triaged: Triaged, runner: PictureRunner, firm: float) -> str | None:
    """Why less than a share of rollouts holds, one of them exactly in the scene and the others around it."""
    assert triaged.shrunk is not None
    assert triaged.lost_stage is not None
    lost = runner.stages[: runner.stages.index(triaged.lost_stage) + 1]
    outcomes = _around(triaged.shrunk, runner)
    if outcomes[0].verdict < Verdict.PASSED:
        return UNJUDGED
    if outcomes[0].lost_stage not in lost:
        return "it passes exactly as it is"
    if sum(outcome.lost_stage in lost for outcome in outcomes) < firm * len(outcomes):
        return f"it fails in less than {firm:.0%} of its neighbourhood"
    for operator, counterpart in triaged.counterparts.items():
        outcomes = _around(counterpart, runner)
        passes = sum(outcome.verdict is Verdict.PASSED for outcome in outcomes)
        if outcomes[0].verdict is not Verdict.PASSED or passes < firm * len(outcomes):
            return f"without {operator} it passes in less than {firm:.0%} of its neighbourhood"
    return None


def _around(scene: Scene, runner: PictureRunner) -> list[Outcome]:
    """A rollout in the scene, and those in its neighbourhood that could be judged."""
    numbers = [EXPORT + MOST + number for number in range(ROLLOUTS)]
    scenes = [scene, *(load_jitter().apply(scene, number) for number in numbers[1:])]
    first, *others = runner.evaluate(scenes, numbers)
    return [first, *(outcome for outcome in others if outcome.verdict >= Verdict.PASSED)]


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
