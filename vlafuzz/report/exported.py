"""The view of an exported corpus."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from vlafuzz.regression.corpus import Corpus, Evidence
from vlafuzz.report.cards import Spaces, card_of_case
from vlafuzz.report.view import SHARES, Chart, Measure, RunRow, View, in_order, operator_rows, title_of
from vlafuzz.statistics import Share
from vlafuzz.tasks.tabletop import task
from vlafuzz.text import duration, named, plural


def view_of_corpus(folder: Path, corpus: Corpus) -> View:
    """The cases, and the evidence from triage."""
    spaces = Spaces(folder)
    cases, runs = corpus.cases, tuple(corpus.runs)
    return View(
        title=title_of(runs),
        source=str(folder),
        headline=_headline(corpus),
        facts=_facts(corpus),
        todo=(),
        runs=runs,
        run_rows=tuple(RunRow(id=number, manifest=run) for number, run in enumerate(runs, start=1)),
        charts=(_evidence(corpus.evidence), _lost(corpus)),
        operators=operator_rows((case.operators, case.causes) for case in cases),
        cards=in_order(
            card_of_case(folder, corpus, case, spaces.of(corpus.runs[case.run])) for case in cases
        ),
    )


def _headline(corpus: Corpus) -> str:
    signatures = plural(len({case.signature for case in corpus.cases}), "signature")
    cases = plural(len(corpus.cases), "minimal failing scene")
    findings = plural(corpus.evidence.findings, "finding")
    return f"{cases}, {signatures}, all solved by the expert; from {findings}."


def _facts(corpus: Corpus) -> tuple[tuple[str, str], ...]:
    evidence, runs = corpus.evidence, corpus.runs
    facts = [
        ("Name", corpus.name),
        ("Policy", named(run.policy for run in runs)),
        ("Task", named(run.task for run in runs)),
        ("Strategy", named(run.strategy for run in runs)),
        ("Budget", f"{sum(run.budget for run in runs)} rollouts in {plural(len(runs), 'run')}"),
        ("Search", plural(evidence.search_rollouts, "rollout")),
        (
            "Triage",
            f"{evidence.triage_rollouts} rollouts of the policy, {evidence.expert_rollouts} of the expert, "
            f"{duration(evidence.seconds)}",
        ),
        ("Distinct signatures", str(len({case.signature for case in corpus.cases}))),
    ]
    facts += [("Renderer", corpus.renderer)] if corpus.renderer else []
    facts += [("Made", corpus.created)] if corpus.created else []
    left_out = ", ".join(f"{count} {reason}" for reason, count in evidence.left_out.items() if count)
    return (*facts, *([("Minimal, but left out", left_out)] if left_out else []))


def _evidence(evidence: Evidence) -> Chart:
    measures = (Measure(name, share, SHARES.get(name, "")) for name, share in evidence.shares.items())
    return Chart("Evidence", "Of the triaged findings of the store.", tuple(measures))


def _lost(corpus: Corpus) -> Chart:
    lost = Counter(case.lost_stage for case in corpus.cases)
    measures = (
        Measure(stage, Share.of_counts(lost[stage], len(corpus.cases)))
        for stage in task(corpus.task).stage_names
    )
    return Chart("Lost stage", "The stage that the policy does not reach; of all cases.", tuple(measures))
