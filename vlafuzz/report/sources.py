"""The views of a store and of an exported corpus."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path

from vlafuzz.common.text import named, plural
from vlafuzz.failures.causes import CauseList, ListedCause
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import locate, read_corpus
from vlafuzz.failures.described import DescribedFailure, space_of, title_of
from vlafuzz.failures.events import told as told_early
from vlafuzz.failures.listed import Listing, listing_of_corpus, listing_of_store
from vlafuzz.model import Scene
from vlafuzz.report.cards import card_of, evidence, sentence, told
from vlafuzz.report.plots import Plot, plot_of
from vlafuzz.report.tables import Standing, Table, cause_table, draws, row_of_run, run_table, standings_of
from vlafuzz.report.view import Head, View
from vlafuzz.search.severity import NAME as SEVERITY, severity_of
from vlafuzz.store.database import is_being_written
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

_TOY = "mini is a small policy that comes with vlafuzz to try it out: its failures say nothing about others."


def view_of(source: Path) -> View:
    """The view of a store or corpus."""
    source = locate(source)
    if source.is_dir():
        return view_of_corpus(source, read_corpus(source))
    with Store.open(source) as store:
        return view_of_store(store)


def view_of_store(store: Store) -> View:
    """The causes and failures of the runs, with the results of triage; nothing to do next while they go on."""
    going_on = is_being_written(store.path)  # before it is read: what ends meanwhile was not interrupted
    runs, listing = store.runs(), listing_of_store(store)
    standings, groups = standings_of(store, listing.causes), _comparable(runs)
    plots = [_plot(store, group) for group in groups]
    of_run = {run.id: plot for group, plot in zip(groups, plots, strict=True) for run in group}
    found = list(_shown(listing, runs))
    more, others = _explained(listing, [(cause, of) for cause, of, _ in found if of])
    causes = (
        card_of(store.path, f"cause-{at}", of, of_run.get((of and of.number) or 0), cause, failures, more.get(of, ()))
        for at, (cause, of, failures) in enumerate(found, start=1)
    )
    failures = (
        card_of(store.path, f"failure-{number}", of, of_run.get(of.number or 0))
        for number, of in enumerate(others, start=1)
    )
    toy = any(run.policy == "mini" for run in listing.runs)
    several = [Table("Policies and tasks", [one.row() for one in standings])] if len(standings) > 1 else []
    return View(
        title=listing.title,
        source=str(store.path),
        phase=_phase(store, runs, listing.causes, going_on=going_on),
        heads=tuple(_head(one, listing, runs, store, going_on=going_on) for one in standings),
        causes=tuple(replace(card, step=None) if going_on else card for card in causes),
        failures=tuple(replace(card, step=None) if going_on else card for card in failures),
        plots=tuple(plot for plot in plots if plot.axes),
        runs=listing.runs,
        tables=(*several, *map(cause_table, listing.causes), run_table(store, runs)) if runs else (),
        todo=() if going_on else listing.todo,
        notes=tuple(filter(None, (told_early(sum(one.before_event for one in listing.failures)), _TOY * toy))),
    )


def _comparable(runs: Sequence[Run]) -> list[list[Run]]:
    """The runs, those that differ in search and seed only together."""
    groups: list[list[Run]] = []
    for run in runs:
        alike = (group for group in groups if run.manifest.comparable(group[0].manifest))
        if group := next(alike, None):
            group.append(run)
        else:
            groups.append([run])
    return groups


def _plot(store: Store, runs: Sequence[Run]) -> Plot:
    """The scenes of some runs that passed or failed, each once; what a run drew at random is random."""
    scenes, severities = dict[str, tuple[Scene, bool, bool]](), list[tuple[float, bool]]()
    for run in runs:
        drawn = draws(store, run)
        for trial in store.trials(run.id):
            if trial.outcome.judged:
                random = drawn(trial) or (trial.scene.digest in scenes and scenes[trial.scene.digest][2])
                scenes[trial.scene.digest] = (trial.scene, not trial.outcome.passed, random)
                if run.manifest.strategy == SEVERITY:
                    severities.append((severity_of(trial.proposal), not trial.outcome.passed))
    space = space_of(store.path, runs[0].manifest)
    return plot_of(title_of([runs[0].manifest]), space, list(scenes.values()), severities)


def _shown(listing: Listing, runs: Sequence[Run]) -> Iterator[tuple[ListedCause, DescribedFailure | None, str]]:
    """Each cause with the failure that shows it, and all failures of its run in words.

    Then what is certified without being in a list, as of random scenes, one failure for each signature.
    """
    owners = {run.id: (run.manifest.key(), run.manifest.task) for run in runs}
    failures = {(digest, one.run.key()): one for one in listing.failures for digest in one.found}
    told = list[tuple[tuple[str, str], ListedCause]]()
    for found in listing.causes:
        for cause in found.causes:
            keys = ((digest, owners[found.run][0]) for digest in cause.found)
            told.append((owners[found.run], cause))
            yield cause, next((failures[key] for key in keys if key in failures), None), found.all_failures
    for one in listing.failures:
        own, cause = (one.run.key(), one.run.task), ListedCause.of_failure(one)
        if one.bucket == "minimal" and not any(of == own and other.explains(one.signature) for of, other in told):
            told.append((own, cause))
            yield cause, one, ""


def _explained(
    listing: Listing, shown: Sequence[tuple[ListedCause, DescribedFailure]]
) -> tuple[dict[DescribedFailure | None, list[DescribedFailure]], list[DescribedFailure]]:
    """For each failure that shows a cause those that it explains as well, and those that no cause explains.

    A certified cause explains what is certified to have it, too, and what is in its range and was not triaged.
    """
    ranges = {(found.of, scene): one for found in listing.causes for scene, one in found.ranges.items()}
    more = dict[DescribedFailure | None, list[DescribedFailure]]()
    cards = [of for _, of in shown]
    left = [one for one in listing.failures if one not in cards]
    for cause, of in shown:
        own = of.run.key(), of.run.task
        alike = [one for one in left if of.bucket == "minimal" and (one.run.key(), one.run.task) == own]
        within = ranges.get((title_of([of.run]), of.scene.digest))
        seen = [one for one in alike if one.bucket == "observed"] if within else []
        more[of] = [one for one in alike if one.bucket == "minimal" and cause.explains(one.signature)]
        more[of] += compress(seen, within.holds([one.scene for one in seen])) if within else ()
        left = [one for one in left if one not in more[of]]
    return more, left


def _head(one: Standing, listing: Listing, runs: Sequence[Run], store: Store, *, going_on: bool) -> Head:
    """The sentence on a policy in a task, by the newest run that looked for causes."""
    numbers = {run.id for run in runs if (run.manifest.model, run.manifest.task) == (one.policy, one.task)}
    found = next((each for each in reversed(listing.causes) if each.run in numbers), None)
    certified = [of for of in listing.failures if of.number in numbers and of.bucket == "minimal"]
    causes = found.causes if found and found.causes else tuple(map(ListedCause.of_failure, certified))
    failed, judged = store.judged(sorted(numbers))
    said = told(found, causes, failed, judged, going_on=going_on)
    left = found.left if found and found.causes else ""
    return Head(f"{one.policy} on {one.task}", said, one.rate, evidence(one.rollouts, found), left)


def _phase(store: Store, runs: Sequence[Run], lists: Sequence[CauseList], *, going_on: bool) -> str:
    if not runs:
        return "no run yet"
    run = runs[-1]
    if run.status != "finished" and run.status != "stopped":
        word = "searching" if run.status == "running" and going_on else "interrupted"
        done, budget = store.rollouts(run.id), run.manifest.budget  # certification may have left some more
        return f"{word}: {done}{f' of {budget}' * (done <= budget)} rollouts done"
    if going_on:
        found = next((one for one in lists if one.run == run.id), None)
        return f"certifying: {found.certified} of {plural(found.found, 'cause')} so far" if found else "triaging"
    return "finished"


def view_of_corpus(folder: Path, corpus: Corpus) -> View:
    """The cases, with the evidence from triage, among the random scenes of the corpus."""
    evidence, listing = corpus.evidence, listing_of_corpus(folder, corpus)
    scenes = [(control.scene, not control.passed, True) for control in corpus.controls]
    scenes += [(case.scene, True, False) for case in corpus.cases]
    plot = plot_of(listing.title, space_of(folder, corpus.runs[0]), scenes)
    causes = [ListedCause.of_failure(one) for one in listing.failures]
    cards = (
        card_of(folder, f"cause-{number}", of, plot, cause)
        for number, (of, cause) in enumerate(zip(listing.failures, causes, strict=True), start=1)
    )
    left_out = named(f"{count} {reason}" for reason, count in evidence.left_out.items() if count)
    lost = Counter(case.lost_stage for case in corpus.cases).most_common()
    made = {
        "corpus": corpus.name,
        "fails at": named(f"{stage} ({number})" for stage, number in lost),
        "rollouts of search": evidence.search_rollouts,
        "of triage": evidence.triage_rollouts,
        "of the expert": evidence.expert_rollouts,
        "minimal, but left out": left_out or "–",
        "renderer": corpus.renderer or "–",
        "made": corpus.created,
    }
    runs = [row_of_run(number, run) for number, run in enumerate(listing.runs, start=1)]
    return View(
        title=listing.title,
        source=str(folder),
        heads=(Head(listing.title, sentence(causes)),) if causes else (),
        causes=tuple(cards),
        plots=(plot,) if plot.axes else (),
        runs=listing.runs,
        tables=(Table("Corpus", [made]), Table("Runs", runs)),
    )
