"""export: from the minimal findings of a store to a bundle. Each is checked once more before it goes in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from itertools import groupby
from typing import NamedTuple, Protocol

from vlafuzz.conditions import provenance
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.evidence import Witness
from vlafuzz.outcome import Verdict
from vlafuzz.regression.corpus import Case, Corpus, Evidence, Share
from vlafuzz.scene import Scene
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.path import nominal
from vlafuzz.triage.pipeline import SceneRunner, repeat
from vlafuzz.triage.summary import summarise

FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


class Checker(SceneRunner, Protocol):
    """A desk that takes pictures."""

    @property
    def renderer(self) -> str | None:
        """What draws the policy's pictures; None for one that sees none."""

    def picture(self, scene: Scene) -> bytes | None:
        """PNG of a scene; None where nothing can be rendered."""


class _Chosen(NamedTuple):
    finding: Finding
    triaged: Triaged
    shrunk: Scene
    witness: Witness


def export(
    store: Store,
    runner: Callable[[Run], Checker],
    *,
    name: str,
    run: int | None = None,
    watch: Callable[[int, int], None] = lambda done, of: None,
) -> Corpus:
    """The minimal findings of a store, each scene once, that hold here and now.

    One holds when the policy fails in it no later than it did, passes in every counterpart, and the witness
    solves it when it is played again.

    Args:
        desk: makes what the findings of a run are checked with.
        name: of the bundle.
        run: only findings that this run saw first.
        watch: hears how many are checked of all.

    Raises:
        UsageError: several tasks or policies are in the store.
        StoreError: it has no minimal finding, or none that holds.
    """
    chosen = _choose(store, run)
    runs = {each.id: each for each in store.runs()}
    numbers = sorted({each.finding.run for each in chosen})
    _check_alike(store, [runs[number] for number in numbers])
    cases: list[Case] = []
    left_out: Counter[str] = Counter()
    renderer, done = None, 0
    watch(0, len(chosen))
    for number, group in groupby(chosen, lambda each: each.finding.run):
        with closing(runner(runs[number])) as tools:
            renderer = tools.renderer
            for each in group:
                case = _case(each, numbers.index(number), tools)
                if isinstance(case, Case):
                    cases.append(case)
                else:
                    left_out[case] += 1
                done += 1
                watch(done, len(chosen))
    if not cases:
        told = ", ".join(f"{reason} ({count})" for reason, count in left_out.items())
        raise StoreError(f"{store.path}: no minimal finding holds: {told}", hint="`vlafuzz triage` it here")
    return Corpus(
        name,
        [runs[number].manifest for number in numbers],
        cases,
        _evidence(store, left_out),
        renderer,
        provenance.versions(),
        datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _choose(store: Store, run: int | None) -> list[_Chosen]:
    """The minimal findings, by run; of those with the same scene left the first."""
    findings = {(each.scene.digest, each.policy_key): each for each in store.findings(run)}
    chosen: dict[Scene, _Chosen] = {}
    for each in store.triaged():
        finding = findings.get((each.scene.digest, each.policy_key))
        if finding and each.bucket == "minimal" and each.shrunk and each.witness:
            chosen.setdefault(each.shrunk, _Chosen(finding, each, each.shrunk, each.witness))
    if not chosen:
        raise StoreError(f"{store.path}: has no minimal finding", hint="`vlafuzz triage` makes them")
    return sorted(chosen.values(), key=lambda each: each.finding.run)


def _check_alike(store: Store, runs: Sequence[Run]) -> None:
    kinds = {f"{run.manifest.policy} on {run.manifest.task}" for run in runs}
    if len(kinds) > 1:
        told = f"{store.path}: has findings of {', '.join(sorted(kinds))}; a corpus has one policy and task"
        raise UsageError(told, hint="--run N takes those of one run")


def _case(chosen: _Chosen, run: int, runner: Checker) -> Case | str:
    """A finding as a case, or why it is none any more."""
    scene, triaged = chosen.shrunk, chosen.triaged
    lost = triaged.lost_stage
    runner.renew()
    confirmation, judged = repeat(runner, scene)
    if not confirmation.confirmed or judged.lost is None or lost is None:
        return FLAKY
    if runner.stages.index(judged.lost) > runner.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(runner, counterpart)[1].verdict is not Verdict.PASSED:
            return f"without {operator} it no longer passes"
    played = runner.play(scene, chosen.witness.actions)
    if played.verdict is not Verdict.PASSED:
        return UNSOLVED
    control = nominal(runner.space, scene)
    return Case(
        scene,
        judged.lost,
        triaged.signature or "",
        triaged.operators,
        triaged.causes,
        triaged.counterparts,
        control,
        repeat(runner, control)[1].verdict is Verdict.PASSED,
        replace(chosen.witness, states_hash=played.rollouts[0].states_hash),
        triaged.scene.digest,
        run,
        confirmation.repeats,
        confirmation.failures,
        triaged.shrink_rollouts,
        runner.picture(scene),
    )


def _evidence(store: Store, left_out: Counter[str]) -> Evidence:
    found = summarise(store)
    counts = {"confirmed": found.confirmed, "witnessed": found.witnessed}
    counts |= {bucket: found.buckets[bucket] for bucket in ("minimal", "base", "unproven", "flaky")}
    trials = (trial for run in store.runs() for trial in store.trials(run.id))
    return Evidence(
        found.findings,
        {name: Share.of_counts(count, found.triaged) for name, count in counts.items()},
        dict(left_out),
        sum(len(trial.outcome.rollouts) for trial in trials),
        found.policy_rollouts,
        found.expert_rollouts,
        found.seconds,
    )
