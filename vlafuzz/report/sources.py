"""The views of a store and of an exported corpus."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import duration, interval, named, percent, plural
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import locate, read_corpus
from vlafuzz.failures.described import Spaces, title_of
from vlafuzz.failures.listed import listing_of_corpus, listing_of_store
from vlafuzz.failures.triage.summary import TriageSummary, summarise
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.counts import Counts, charts_of, count, row_of_run, run_table, standings_of
from vlafuzz.report.effects import effects_of
from vlafuzz.report.view import Card, Chart, Measure, Table, View, cause_table
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of
from vlafuzz.worlds.provenance import by_place, in_words

_TOY = "mini is a small policy that comes with vlafuzz to try it out: its failures say nothing about others."
_SEVERAL = (
    "The runs are of several models or tasks, and the shares above are of all of them together; "
    "the table of policies and tasks has the rate of each."
)


def view_of(source: Path) -> View:
    """The view of a store or corpus."""
    source = locate(source)
    if source.is_dir():
        return view_of_corpus(source, read_corpus(source))
    with Store.open(source) as store:
        return view_of_store(store)


def view_of_store(store: Store) -> View:
    """The runs, and the failures with the results of triage."""
    runs, counts, summary = store.runs(), count(store), summarise(store)
    listing = listing_of_store(store)
    standings = standings_of(store, counts, listing.causes)
    several = [Table("Policies and tasks", [one.row() for one in standings])] if len(standings) > 1 else []
    notes = [
        f"Run {run.id} goes on: {counts.rollouts[run.id]} of {run.manifest.budget} rollouts are done."
        for run in runs
        if run.status == "running"
    ]
    notes += [_TOY] * any(run.policy == "mini" for run in listing.runs) + [_SEVERAL] * bool(several)
    return View(
        title=listing.title,
        source=str(store.path),
        headline=_headline(listing.runs, counts, summary),
        facts=_facts(runs, counts, summary),
        todo=listing.todo,
        runs=listing.runs,
        run_table=run_table(store),
        charts=charts_of(counts),
        tables=(*several, *map(cause_table, listing.causes), *_effects(store, runs)),
        cards=tuple(map(Card, listing.failures)),
        notes=tuple(notes),
    )


def _effects(store: Store, runs: Sequence[Run]) -> list[Table]:
    """One table for all runs that differ in search and seed only."""
    spaces, seen, tables = Spaces(store.path), list[Manifest](), list[Table]()
    for run in runs:
        if not any(run.manifest.comparable(other) for other in seen):
            seen.append(run.manifest)
            if found := effects_of(store, run, spaces.of(run.manifest)):
                tables.append(replace(found.table, title=f"{found.table.title}: {title_of([run.manifest])}"))
    return tables


def _headline(runs: Sequence[Manifest], counts: Counts, summary: TriageSummary) -> str:
    failed, errors = counts.failed, counts.verdicts[Verdict.ERROR]
    if not failed.of:
        broken = f": {plural(errors, 'rollout')} ended in errors" if errors else ""
        return f"No scene was judged{broken}."
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
    spent = _spent(summary.policy_rollouts, summary.expert_rollouts, summary.seconds) if summary.triaged else ""
    facts = (
        ("Policy checkup", named(run.checkup for run in manifests if run.checkup not in ("", "ok"))),
        ("Search", f"{plural(counts.rollouts.total(), 'rollout')}, {searched}"),
        ("Triage", spent),
        ("Made with", named(run.simulator.replace("/", ", ") for run in manifests)),
        _places({run.id: run.manifest for run in runs}),
    )
    return tuple((name, value) for name, value in facts if value)


def _places(runs: Mapping[int, Manifest]) -> tuple[str, str]:
    """Where runs were made, by number."""
    places = {number: run.place for number, run in runs.items()}
    if len(set(places.values())) > 1:
        return "Made at several places, whose outcomes may differ", by_place(places)
    return "Made at", "".join(map(in_words, set(places.values())))


def _spent(policy: int, expert: int, seconds: float) -> str:
    return f"{policy} rollouts of the policy, {expert} of the expert, {duration(seconds)}"


def view_of_corpus(folder: Path, corpus: Corpus) -> View:
    """The cases, and the evidence from triage."""
    cases, evidence, listing = corpus.cases, corpus.evidence, listing_of_corpus(folder, corpus)
    lost = Counter(case.lost_stage for case in cases)
    stages = world_of(corpus.task).task(corpus.task).stage_names
    measures = tuple(Measure(stage, Share.of_counts(lost[stage], len(cases))) for stage in stages)
    causes = plural(len({case.signature for case in cases}), "cause")
    scenes, findings = plural(len(cases), "minimal failing scene"), plural(evidence.findings, "finding")
    left_out = ", ".join(f"{count} {reason}" for reason, count in evidence.left_out.items() if count)
    facts = (
        ("Name", corpus.name),
        ("Search", plural(evidence.search_rollouts, "rollout")),
        ("Triage", _spent(evidence.triage_rollouts, evidence.expert_rollouts, evidence.seconds)),
        _places(dict(enumerate(corpus.runs, start=1))),
        ("Renderer", corpus.renderer or ""),
        ("Made", corpus.created),
        ("Minimal, but left out", left_out),
    )
    return View(
        title=listing.title,
        source=str(folder),
        headline=f"{scenes}, {causes}, all solved by the expert; from {findings}.",
        facts=tuple((name, value) for name, value in facts if value),
        runs=listing.runs,
        run_table=Table("Runs", [row_of_run(number, run) for number, run in enumerate(listing.runs, start=1)]),
        charts=(Chart("Lost stage", "The stage that the policy does not reach; of all cases.", measures),),
        cards=tuple(map(Card, listing.failures)),
    )
