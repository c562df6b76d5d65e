"""The view of a store."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from vlafuzz.corpus.bundle import Share
from vlafuzz.corpus.harvest import Harvest, harvest
from vlafuzz.corpus.records import Run, Triaged
from vlafuzz.corpus.store import Corpus
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
from vlafuzz.report.words import duration, interval, named, percent, plural


def view_of_store(corpus: Corpus) -> View:
    """Its runs, and its findings with what triage made of them."""
    runs, counts, crop = corpus.runs(), count(corpus), harvest(corpus)
    manifests = tuple(run.manifest for run in runs)
    triaged = corpus.triaged()
    return View(
        title=title_of(manifests),
        source=str(corpus.path),
        headline=_headline(counts, crop),
        facts=_facts(runs, counts, crop),
        todo=_todo(corpus.path, crop),
        runs=manifests,
        run_rows=tuple(run_row(corpus, run) for run in runs),
        charts=_charts(counts, crop),
        operators=_operators(triaged),
        cards=in_order(_merged(_cards(corpus, runs, triaged))),
    )


def _headline(counts: Counts, crop: Harvest) -> str:
    failed = counts.failed
    if not failed.of:
        return "No scene was judged."
    if not crop.findings:
        return f"No scene failed: all {failed.of} that were judged passed."
    scenes = f"{failed.count} of {failed.of} judged scenes failed"
    sure = f"95\N{NO-BREAK SPACE}% interval {interval(failed.low, failed.high)}"
    share = f"{scenes} ({percent(failed.count / failed.of)}, {sure})"
    if not crop.triaged:
        return f"{share}. None of the findings was triaged."
    bugs = plural(crop.distinct_signatures, "distinct bug")
    return f"{share}. {crop.triaged} of {plural(crop.findings, 'finding')} were triaged: {bugs}."


def _facts(runs: Sequence[Run], counts: Counts, crop: Harvest) -> tuple[tuple[str, str], ...]:
    manifests = [run.manifest for run in runs]
    searched = sum(run.seconds or 0.0 for run in runs)
    facts = [
        ("Subject", named(run.subject for run in manifests)),
        ("Its checkup", named(run.checkup for run in manifests if run.checkup not in ("", "ok"))),
        ("Task", named(run.task for run in manifests)),
        ("Strategy", named(run.strategy for run in manifests)),
        ("Budget", f"{sum(run.budget for run in manifests)} rollouts in {plural(len(runs), 'run')}"),
        ("Search", f"{plural(counts.rollouts, 'rollout')}, {duration(searched)}"),
        ("Distinct cells before triage", str(crop.distinct_cells)),
    ]
    if crop.triaged:
        rollouts = f"{crop.subject_rollouts} rollouts of the subject, {crop.expert_rollouts} of the expert"
        facts += [
            ("Distinct signatures after", str(crop.distinct_signatures)),
            ("Triage", f"{rollouts}, {duration(crop.seconds)}"),
        ]
    if any(run.simulator for run in manifests):
        facts.append(("Made with", named(run.simulator.replace("/", ", ") for run in manifests)))
    if crop.deviating_before is not None:
        said = f"{crop.deviating_before:g} before shrinking, {crop.deviating_after:g} after"
        facts.append(("Operators not nominal, median", said))
    return tuple((name, value) for name, value in facts if value)


def _todo(store: Path, crop: Harvest) -> tuple[tuple[str, str], ...]:
    left = crop.findings - crop.triaged
    if not left:
        return ()
    command = shlex.join(["vlafuzz", "triage", str(store)])
    told = f"{plural(left, 'finding')} {'is' if left == 1 else 'are'} not triaged yet"
    return ((f"{told}. This says which can be trusted and what they are due to:", command),)


def _charts(counts: Counts, crop: Harvest) -> tuple[Chart, ...]:
    charts = [verdict_chart(counts), *funnels(counts)]
    if crop.triaged:
        came = crop.buckets | {"confirmed": crop.confirmed, "witnessed": crop.witnessed}
        measures = [
            Measure(name, Share.of_counts(came[name], crop.triaged), explained)
            for name, explained in SHARES.items()
        ]
        says = f"Of the {crop.triaged} findings that were triaged."
        charts.append(Chart("Evidence", says, tuple(measures)))
    return tuple(charts)


def _operators(triaged: Iterable[Triaged]) -> tuple[OperatorRow, ...]:
    """Of what was shrunk, without those that fail at nominal."""
    shrunk = [each for each in triaged if each.shrunk is not None and each.bucket != "base"]
    return operator_rows((each.operators, each.causes) for each in shrunk)


def _cards(corpus: Corpus, runs: Sequence[Run], triaged: Sequence[Triaged]) -> Iterator[Card]:
    manifests = {run.id: run.manifest for run in runs}
    spaces = Spaces(corpus.path)
    known = {(each.scene.digest, each.subject_key): each for each in triaged}
    for finding in corpus.findings():
        run = manifests[finding.run]
        made = known.get((finding.scene.digest, finding.subject_key))
        if made is None:
            yield card_of_finding(corpus.path, finding, run, spaces.of(run))
        else:
            yield card_of_triaged(corpus.path, made, finding, run, spaces.of(run))


def _merged(cards: Iterable[Card]) -> Iterable[Card]:
    """Findings of which the same scene is left, as one."""
    found: dict[tuple[str, str, str], Card] = {}
    for card in cards:
        key = (card.scene.digest, card.run.subject_key, card.bucket)
        first = found.get(key)
        found[key] = replace(first, found=first.found + card.found) if first else card
    return found.values()
