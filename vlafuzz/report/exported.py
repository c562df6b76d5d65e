"""The view of an exported corpus."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from vlafuzz.corpus.bundle import Bundle, Evidence, Share
from vlafuzz.report.cards import Spaces, card_of_case
from vlafuzz.report.view import SHARES, Chart, Measure, RunRow, View, in_order, operator_rows, title_of
from vlafuzz.report.words import duration, named, plural
from vlafuzz.tasks.tabletop import task


def view_of_bundle(folder: Path, bundle: Bundle) -> View:
    """Its cases, and what triage of the stores that they are from came to."""
    spaces = Spaces(folder)
    cases, runs = bundle.cases, tuple(bundle.runs)
    return View(
        title=title_of(runs),
        source=str(folder),
        headline=_headline(bundle),
        facts=_facts(bundle),
        todo=(),
        runs=runs,
        run_rows=tuple(
            RunRow(number, run.task, run.subject, run.strategy, run.seed, run.budget, "", None)
            for number, run in enumerate(runs, start=1)
        ),
        charts=(_evidence(bundle.evidence), _lost(bundle)),
        operators=operator_rows((case.operators, case.causes) for case in cases),
        cards=in_order(
            card_of_case(folder, bundle, case, spaces.of(bundle.runs[case.run])) for case in cases
        ),
    )


def _headline(bundle: Bundle) -> str:
    bugs = plural(len({case.signature for case in bundle.cases}), "bug")
    cases = plural(len(bundle.cases), "minimal failing scene")
    return f"{cases}, {bugs}, each solved by the expert; of {plural(bundle.evidence.findings, 'finding')}."


def _facts(bundle: Bundle) -> tuple[tuple[str, str], ...]:
    evidence, runs = bundle.evidence, bundle.runs
    facts = [
        ("Name", bundle.name),
        ("Subject", named(run.subject for run in runs)),
        ("Task", named(run.task for run in runs)),
        ("Strategy", named(run.strategy for run in runs)),
        ("Budget", f"{sum(run.budget for run in runs)} rollouts in {plural(len(runs), 'run')}"),
        ("Search", plural(evidence.search_rollouts, "rollout")),
        (
            "Triage",
            f"{evidence.triage_rollouts} rollouts of the subject, {evidence.expert_rollouts} of the expert, "
            f"{duration(evidence.seconds)}",
        ),
        ("Distinct signatures", str(len({case.signature for case in bundle.cases}))),
    ]
    facts += [("Renderer", bundle.renderer)] if bundle.renderer else []
    facts += [("Made", bundle.created)] if bundle.created else []
    left_out = ", ".join(f"{count} {reason}" for reason, count in evidence.left_out.items() if count)
    return (*facts, *([("Minimal, but left out", left_out)] if left_out else []))


def _evidence(evidence: Evidence) -> Chart:
    measures = (Measure(name, share, SHARES.get(name, "")) for name, share in evidence.shares.items())
    return Chart("Evidence", "Of the findings of the stores that were triaged.", tuple(measures))


def _lost(bundle: Bundle) -> Chart:
    lost = Counter(case.lost_stage for case in bundle.cases)
    measures = (
        Measure(stage, Share.of_counts(lost[stage], len(bundle.cases)))
        for stage in task(bundle.task).stage_names
    )
    return Chart("Lost stage", "The stage that the subject does not reach, of all cases.", tuple(measures))
