"""The views of a store and of an exported corpus."""

import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path

from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration, interval, named, percent, plural
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.triage.pipeline import hours
from vlafuzz.failures.triage.summary import TriageSummary, summarise
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.alike import alike_as_one
from vlafuzz.report.cards import Spaces, card_of_case, card_of_finding, card_of_triaged
from vlafuzz.report.causes import CauseList, all_causes
from vlafuzz.report.counts import Counts, count, funnels, run_row, verdict_chart
from vlafuzz.report.effects import effects_of
from vlafuzz.report.standings import Standing, standings
from vlafuzz.report.view import SHARES, Card, Chart, Measure, RunRow, Table, View, in_order, operator_rows, title_of
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Manifest, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of
from vlafuzz.worlds.place import by_place, in_words

_TOY = "mini is a small policy that comes with vlafuzz to try it out: its failures say nothing about others."


def view_of_store(store: Store) -> View:
    """The runs, and the findings with the results of triage."""
    runs, counts, summary = store.runs(), count(store), summarise(store)
    manifests = tuple(run.manifest for run in runs)
    triaged, causes = store.triaged(), all_causes(store)
    standing = standings(store, runs, counts, causes)
    shrunk = (row for row in triaged if row.shrunk is not None and row.bucket != "base")
    return View(
        title=title_of(manifests),
        source=str(store.path),
        headline=_headline(manifests, counts, summary),
        facts=_facts(runs, counts, summary),
        todo=() if _explained(runs, causes) else _todo(store, summary, manifests),
        runs=manifests,
        run_rows=tuple(run_row(store, run) for run in runs),
        charts=_charts(counts, summary),
        operators=operator_rows((row.operators, row.causes) for row in shrunk),
        causes=(*_standing(standing), *(one.table for one in causes), *_effects(store, runs)),
        cards=_causes_first(_cards(store, runs, triaged), causes, runs, Spaces(store.path)),
        notes=tuple(_notes(manifests, several=len(standing) > 1)),
    )


def _standing(several: Sequence[Standing]) -> Iterator[Table]:
    """A row for each policy and task, where there are several."""
    if len(several) > 1:
        yield Table("Policies and tasks", [one.row() for one in several])


def _notes(runs: Sequence[Manifest], *, several: bool) -> Iterator[str]:
    if any(run.policy == "mini" for run in runs):
        yield _TOY
    if several:
        yield (
            "The runs are of several models or tasks, and the shares above are of all of them together; "
            "the table of policies and tasks has the rate of each."
        )


def _effects(store: Store, runs: Sequence[Run]) -> Iterator[Table]:
    """One table for all runs that differ in search and seed only."""
    spaces, seen = Spaces(store.path), list[Run]()
    for run in runs:
        if any(run.manifest.comparable(other.manifest) for other in seen):
            continue
        seen.append(run)
        if found := effects_of(store, run, spaces.of(run.manifest)):
            of = f"{found.table.title}: {title_of([run.manifest])}"
            yield replace(found.table, title=of)


def _headline(runs: Sequence[Manifest], counts: Counts, summary: TriageSummary) -> str:
    failed = counts.failed
    if not failed.of:
        errors = counts.verdicts[Verdict.ERROR]
        return (
            f"No scene was judged: {plural(errors, 'rollout')} ended in errors." if errors else "No scene was judged."
        )
    if not summary.findings:
        return f"No scene failed: all {failed.of} judged scenes passed."
    share = f"{failed.count} of {failed.of} judged scenes failed"
    if all(run.strategy == RANDOM for run in runs):
        bounds = f"95% interval {interval(failed.low, failed.high)}"
        share += f" ({percent(failed.count / failed.of)}, {bounds})"
    else:
        share += ", which is not the policy's failure rate, as the scenes were chosen"
    if not summary.triaged:
        return f"{share}. None of the findings was triaged."
    causes = plural(summary.distinct_signatures, "distinct cause")
    return f"{share}. {summary.triaged} of {plural(summary.findings, 'finding')} were triaged: {causes}."


def _facts(runs: Sequence[Run], counts: Counts, summary: TriageSummary) -> tuple[tuple[str, str], ...]:
    manifests = [run.manifest for run in runs]
    searched = duration(sum(run.seconds or 0.0 for run in runs))
    if unfinished := sum(run.seconds is None for run in runs):
        searched = "still running" if len(runs) == 1 else f"{searched} and {plural(unfinished, 'unfinished run')}"
    facts = [*_of_runs(manifests), ("Search", f"{plural(counts.rollouts, 'rollout')}, {searched}")]
    checkups = named(run.checkup for run in manifests if run.checkup not in ("", "ok"))
    facts.insert(1, ("Policy checkup", checkups))
    if summary.triaged:
        spent = _spent(summary.policy_rollouts, summary.expert_rollouts, summary.seconds)
        facts.append(("Triage", spent))
    if any(run.simulator for run in manifests):
        facts.append(("Made with", named(run.simulator.replace("/", ", ") for run in manifests)))
    facts.append(_places({run.id: run.manifest for run in runs}))
    if summary.deviating_before is not None:
        medians = f"{summary.deviating_before:g} before shrinking, {summary.deviating_after:g} after"
        facts.append(("Operators not nominal, median", medians))
    return tuple((name, value) for name, value in facts if value)


def _of_runs(runs: Sequence[Manifest]) -> list[tuple[str, str]]:
    return [
        ("Policy", named(str(run.tested) for run in runs)),
        ("Task", named(run.task for run in runs)),
        ("Strategy", named(run.strategy for run in runs)),
        ("Budget", f"{sum(run.budget for run in runs)} rollouts in {plural(len(runs), 'run')}"),
    ]


def _places(runs: Mapping[int, Manifest]) -> tuple[str, str]:
    """Where runs were made, by number."""
    places = {number: run.place for number, run in runs.items()}
    if len(set(places.values())) > 1:
        return "Made at several places, whose outcomes may differ", by_place(places)
    return "Made at", "".join(map(in_words, set(places.values())))


def _spent(policy: int, expert: int, seconds: float) -> str:
    return f"{policy} rollouts of the policy, {expert} of the expert, {duration(seconds)}"


def _explained(runs: Sequence[Run], lists: Sequence[CauseList]) -> bool:
    """Whether every run found causes, and all of them are triaged."""
    buckets = {cause.bucket for one in lists for cause in one.causes}
    return len(lists) == len(runs) and all(one.causes for one in lists) and "observed" not in buckets


def _todo(store: Store, summary: TriageSummary, runs: Iterable[Manifest]) -> tuple[tuple[str, str], ...]:
    left = summary.findings - summary.triaged
    if not left:
        return ()
    command = shlex.join(["vlafuzz", "triage", str(store.path), *trust_flag(*(run.policy for run in runs))])
    untriaged = f"{plural(left, 'finding')} {'is' if left == 1 else 'are'} not triaged yet"
    takes = hours(store, left)
    return ((f"{untriaged}. Triage confirms findings and names their causes{takes}:", command),)


def _charts(counts: Counts, summary: TriageSummary) -> tuple[Chart, ...]:
    charts = [verdict_chart(counts), *funnels(counts)]
    if summary.triaged:
        counted = {"confirmed": summary.confirmed, "witnessed": summary.witnessed, "by sight": summary.by_sight}
        numbers = summary.buckets | counted
        shares = {name: Share.of_counts(numbers[name], summary.triaged) for name in SHARES}
        charts.append(_evidence(shares, f"Of the {summary.triaged} triaged findings."))
    return tuple(charts)


def _evidence(shares: Mapping[str, Share], says: str) -> Chart:
    measures = (Measure(name, share, SHARES.get(name, "")) for name, share in shares.items())
    return Chart("Evidence", says, tuple(measures))


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


def _causes_first(
    cards: Iterable[Card], lists: Sequence[CauseList], runs: Sequence[Run], spaces: Spaces
) -> tuple[Card, ...]:
    """The cards of causes, in the order of their lists, then the others; alike ones are one."""
    policy = {run.id: run.manifest.key() for run in runs}
    found = [(digest, policy[one.run]) for one in lists for cause in one.causes for digest in cause.found]
    ranks = {key: rank for rank, key in reversed(list(enumerate(found)))}
    distinct = alike_as_one(in_order(_merged(cards)), spaces, ranks)

    def rank(card: Card) -> float:
        return min(ranks.get((name, card.run.key()), inf) for name in card.findings)

    return tuple(sorted(distinct, key=rank))


def _merged(cards: Iterable[Card]) -> Iterable[Card]:
    """One card for all findings with the same minimal scene."""
    merged: dict[tuple[str, str, str], Card] = {}
    for card in cards:
        key = (card.scene.digest, card.run.key(), card.bucket)
        first = merged.get(key)
        merged[key] = replace(first, findings=first.findings + card.findings) if first else card
    return merged.values()


def view_of_corpus(folder: Path, corpus: Corpus) -> View:
    """The cases, and the evidence from triage."""
    spaces = Spaces(folder)
    cases, runs = corpus.cases, tuple(corpus.runs)
    return View(
        title=title_of(runs),
        source=str(folder),
        headline=_corpus_headline(corpus),
        facts=_corpus_facts(corpus),
        todo=(),
        runs=runs,
        run_rows=tuple(RunRow(id=number, manifest=run) for number, run in enumerate(runs, start=1)),
        charts=(_evidence(corpus.evidence.shares, "Of the triaged findings of the store."), _lost(corpus)),
        operators=operator_rows((case.operators, case.causes) for case in cases),
        cards=in_order(card_of_case(folder, corpus, case, spaces.of(corpus.runs[case.run])) for case in cases),
    )


def _corpus_headline(corpus: Corpus) -> str:
    causes = plural(len({case.signature for case in corpus.cases}), "cause")
    cases = plural(len(corpus.cases), "minimal failing scene")
    findings = plural(corpus.evidence.findings, "finding")
    return f"{cases}, {causes}, all solved by the expert; from {findings}."


def _corpus_facts(corpus: Corpus) -> tuple[tuple[str, str], ...]:
    evidence, left_out = corpus.evidence, corpus.evidence.left_out.items()
    facts = [
        ("Name", corpus.name),
        *_of_runs(corpus.runs),
        ("Search", plural(evidence.search_rollouts, "rollout")),
        ("Triage", _spent(evidence.triage_rollouts, evidence.expert_rollouts, evidence.seconds)),
        _places(dict(enumerate(corpus.runs, start=1))),
        ("Renderer", corpus.renderer or ""),
        ("Made", corpus.created),
        ("Minimal, but left out", ", ".join(f"{count} {reason}" for reason, count in left_out if count)),
    ]
    return tuple((name, value) for name, value in facts if value)


def _lost(corpus: Corpus) -> Chart:
    lost, cases = Counter(case.lost_stage for case in corpus.cases), len(corpus.cases)
    stages = world_of(corpus.task).task(corpus.task).stage_names
    measures = (Measure(stage, Share.of_counts(lost[stage], cases)) for stage in stages)
    return Chart("Lost stage", "The stage that the policy does not reach; of all cases.", tuple(measures))
