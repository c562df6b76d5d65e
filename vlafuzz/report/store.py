"""The view of a store."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from vlafuzz.report.cards import Spaces, card_of_finding, card_of_triaged
from vlafuzz.report.counts import Counts, count, funnels, run_row, verdict_chart
from vlafuzz.report.view import (
    SHARES,
    Card,
    Chart,
    Measure,
    OperatorRow,
    View,
    in_order,
    operator_rows,
    title_of,
)
from vlafuzz.statistics import Share
from vlafuzz.store.records import Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.text import duration, interval, named, percent, plural
from vlafuzz.triage.summary import TriageSummary, summarise


def view_of_store(store: Store) -> View:
    """The runs, and the findings with the results of triage."""
    runs, counts, summary = store.runs(), count(store), summarise(store)
    manifests = tuple(run.manifest for run in runs)
    triaged = store.triaged()
    return View(
        title=title_of(manifests),
        source=str(store.path),
        headline=_headline(counts, summary),
        facts=_facts(runs, counts, summary),
        todo=_todo(store.path, summary),
        runs=manifests,
        run_rows=tuple(run_row(store, run) for run in runs),
        charts=_charts(counts, summary),
        operators=_operators(triaged),
        cards=in_order(_merged(_cards(store, runs, triaged))),
    )


def _headline(counts: Counts, summary: TriageSummary) -> str:
    failed = counts.failed
    if not failed.of:
        return "No scene was judged."
    if not summary.findings:
        return f"No scene failed: all {failed.of} judged scenes passed."
    scenes = f"{failed.count} of {failed.of} judged scenes failed"
    bounds = f"95% interval {interval(failed.low, failed.high)}"
    share = f"{scenes} ({percent(failed.count / failed.of)}, {bounds})"
    if not summary.triaged:
        return f"{share}. None of the findings was triaged."
    signatures = plural(summary.distinct_signatures, "distinct signature")
    return f"{share}. {summary.triaged} of {plural(summary.findings, 'finding')} were triaged: {signatures}."


def _facts(runs: Sequence[Run], counts: Counts, summary: TriageSummary) -> tuple[tuple[str, str], ...]:
    manifests = [run.manifest for run in runs]
    searched = sum(run.seconds or 0.0 for run in runs)
    facts = [
        ("Policy", named(run.policy for run in manifests)),
        ("Policy checkup", named(run.checkup for run in manifests if run.checkup not in ("", "ok"))),
        ("Task", named(run.task for run in manifests)),
        ("Strategy", named(run.strategy for run in manifests)),
        ("Budget", f"{sum(run.budget for run in manifests)} rollouts in {plural(len(runs), 'run')}"),
        ("Search", f"{plural(counts.rollouts, 'rollout')}, {duration(searched)}"),
        ("Distinct cells before triage", str(summary.distinct_cells)),
    ]
    if summary.triaged:
        rollouts = (
            f"{summary.policy_rollouts} rollouts of the policy, {summary.expert_rollouts} of the expert"
        )
        facts += [
            ("Distinct signatures after", str(summary.distinct_signatures)),
            ("Triage", f"{rollouts}, {duration(summary.seconds)}"),
        ]
    if any(run.simulator for run in manifests):
        facts.append(("Made with", named(run.simulator.replace("/", ", ") for run in manifests)))
    if summary.deviating_before is not None:
        medians = f"{summary.deviating_before:g} before shrinking, {summary.deviating_after:g} after"
        facts.append(("Operators not nominal, median", medians))
    return tuple((name, value) for name, value in facts if value)


def _todo(store: Path, summary: TriageSummary) -> tuple[tuple[str, str], ...]:
    left = summary.findings - summary.triaged
    if not left:
        return ()
    command = shlex.join(["vlafuzz", "triage", str(store)])
    untriaged = f"{plural(left, 'finding')} {'is' if left == 1 else 'are'} not triaged yet"
    return ((f"{untriaged}. Triage confirms findings and names their causes:", command),)


def _charts(counts: Counts, summary: TriageSummary) -> tuple[Chart, ...]:
    charts = [verdict_chart(counts), *funnels(counts)]
    if summary.triaged:
        numbers = summary.buckets | {"confirmed": summary.confirmed, "witnessed": summary.witnessed}
        measures = [
            Measure(name, Share.of_counts(numbers[name], summary.triaged), meaning)
            for name, meaning in SHARES.items()
        ]
        says = f"Of the {summary.triaged} triaged findings."
        charts.append(Chart("Evidence", says, tuple(measures)))
    return tuple(charts)


def _operators(triaged: Iterable[Triaged]) -> tuple[OperatorRow, ...]:
    """Over the shrunk findings, without those that fail at nominal."""
    shrunk = [row for row in triaged if row.shrunk is not None and row.bucket != "base"]
    return operator_rows((row.operators, row.causes) for row in shrunk)


def _cards(store: Store, runs: Sequence[Run], triaged: Sequence[Triaged]) -> Iterator[Card]:
    manifests = {run.id: run.manifest for run in runs}
    spaces = Spaces(store.path)
    rows = {row.key: row for row in triaged}
    for finding in store.findings():
        run = manifests[finding.run]
        row = rows.get(finding.key)
        if row is None:
            yield card_of_finding(store.path, finding, run, spaces.of(run))
        else:
            yield card_of_triaged(store.path, row, finding, run, spaces.of(run))


def _merged(cards: Iterable[Card]) -> Iterable[Card]:
    """One card for all findings with the same minimal scene."""
    merged: dict[tuple[str, str, str], Card] = {}
    for card in cards:
        key = (card.scene.digest, card.run.key(), card.bucket)
        first = merged.get(key)
        merged[key] = replace(first, findings=first.findings + card.findings) if first else card
    return merged.values()
