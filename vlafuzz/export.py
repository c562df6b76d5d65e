"""export: from the minimal findings of a store to a bundle. Each is checked once more before it goes in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from itertools import groupby
from typing import NamedTuple, Protocol

from vlafuzz.corpus import provenance
from vlafuzz.corpus.bundle import Bundle, Case, Evidence, Share
from vlafuzz.corpus.harvest import harvest
from vlafuzz.corpus.records import Finding, Run, Triaged
from vlafuzz.corpus.store import Corpus
from vlafuzz.errors import CorpusError, UsageError
from vlafuzz.evidence import Witness
from vlafuzz.findings import Desk, repeat
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.triage.way import nominal

FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


class Checker(Desk, Protocol):
    """A desk that takes pictures."""

    @property
    def renderer(self) -> str | None:
        """What draws the subject's pictures; None for one that sees none."""

    def picture(self, scene: Scene) -> bytes | None:
        """PNG of a scene; None where nothing can be rendered."""


class _Chosen(NamedTuple):
    finding: Finding
    triaged: Triaged
    shrunk: Scene
    witness: Witness


def export(
    corpus: Corpus,
    desk: Callable[[Run], Checker],
    *,
    name: str,
    run: int | None = None,
    watch: Callable[[int, int], None] = lambda done, of: None,
) -> Bundle:
    """The minimal findings of a store, each scene once, that hold here and now.

    One holds when the subject fails in it no later than it did, passes in every counterpart, and the witness
    solves it when it is played again.

    Args:
        desk: makes what the findings of a run are checked with.
        name: of the bundle.
        run: only findings that this run saw first.
        watch: hears how many are checked of all.

    Raises:
        UsageError: several tasks or subjects are in the store.
        CorpusError: it has no minimal finding, or none that holds.
    """
    chosen = _choose(corpus, run)
    runs = {each.id: each for each in corpus.runs()}
    numbers = sorted({each.finding.run for each in chosen})
    _check_alike(corpus, [runs[number] for number in numbers])
    cases: list[Case] = []
    left_out: Counter[str] = Counter()
    renderer, done = None, 0
    watch(0, len(chosen))
    for number, group in groupby(chosen, lambda each: each.finding.run):
        with closing(desk(runs[number])) as tools:
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
        raise CorpusError(f"{corpus.path}: no minimal finding holds: {told}", hint="`vlafuzz triage` it here")
    return Bundle(
        name,
        [runs[number].manifest for number in numbers],
        cases,
        _evidence(corpus, left_out),
        renderer,
        provenance.versions(),
        datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _choose(corpus: Corpus, run: int | None) -> list[_Chosen]:
    """The minimal findings, by run; of those with the same scene left the first."""
    findings = {(each.scene.digest, each.subject_key): each for each in corpus.findings(run)}
    chosen: dict[Scene, _Chosen] = {}
    for each in corpus.triaged():
        finding = findings.get((each.scene.digest, each.subject_key))
        if finding and each.bucket == "minimal" and each.shrunk and each.witness:
            chosen.setdefault(each.shrunk, _Chosen(finding, each, each.shrunk, each.witness))
    if not chosen:
        raise CorpusError(f"{corpus.path}: has no minimal finding", hint="`vlafuzz triage` makes them")
    return sorted(chosen.values(), key=lambda each: each.finding.run)


def _check_alike(corpus: Corpus, runs: Sequence[Run]) -> None:
    kinds = {f"{run.manifest.subject} on {run.manifest.task}" for run in runs}
    if len(kinds) > 1:
        told = f"{corpus.path}: has findings of {', '.join(sorted(kinds))}; a corpus has one subject and task"
        raise UsageError(told, hint="--run N takes those of one run")


def _case(chosen: _Chosen, run: int, desk: Checker) -> Case | str:
    """A finding as a case, or why it is none any more."""
    scene, triaged = chosen.shrunk, chosen.triaged
    lost = triaged.lost_stage
    desk.renew()
    confirmation, judged = repeat(desk, scene)
    if not confirmation.confirmed or judged.lost is None or lost is None:
        return FLAKY
    if desk.stages.index(judged.lost) > desk.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(desk, counterpart)[1].verdict is not Verdict.PASSED:
            return f"without {operator} it no longer passes"
    played = desk.play(scene, chosen.witness.actions)
    if played.verdict is not Verdict.PASSED:
        return UNSOLVED
    control = nominal(desk.space, scene)
    return Case(
        scene,
        judged.lost,
        triaged.signature or "",
        triaged.operators,
        triaged.causes,
        triaged.counterparts,
        control,
        repeat(desk, control)[1].verdict is Verdict.PASSED,
        replace(chosen.witness, states_hash=played.rollouts[0].states_hash),
        triaged.scene.digest,
        run,
        confirmation.repeats,
        confirmation.failures,
        triaged.shrink_rollouts,
        desk.picture(scene),
    )


def _evidence(corpus: Corpus, left_out: Counter[str]) -> Evidence:
    found = harvest(corpus)
    counts = {"confirmed": found.confirmed, "witnessed": found.witnessed}
    counts |= {bucket: found.buckets[bucket] for bucket in ("minimal", "base", "unproven", "flaky")}
    trials = (trial for run in corpus.runs() for trial in corpus.trials(run.id))
    return Evidence(
        found.findings,
        {name: Share.of_counts(count, found.triaged) for name, count in counts.items()},
        dict(left_out),
        sum(len(trial.outcome.rollouts) for trial in trials),
        found.subject_rollouts,
        found.expert_rollouts,
        found.seconds,
    )
