"""Lists of failures: those of causes first, and those with one minimal scene as one."""

import pathlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

from vlafuzz.common.plugins import command
from vlafuzz.common.text import plural
from vlafuzz.failures.causes import CauseList, all_causes
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import locate, read_corpus
from vlafuzz.failures.described import BUCKETS, DescribedFailure, described, described_case, title_of
from vlafuzz.failures.events import failed_before
from vlafuzz.failures.triage.pipeline import hours
from vlafuzz.store.records import Manifest, Run
from vlafuzz.store.store import Store


@dataclass(frozen=True, eq=False, kw_only=True)
class Listing:
    """The failures of a store or corpus.

    Attributes:
        causes: of every run whose strategy looks for them.
        failures: those of causes in the order of their lists, then the others, by evidence, most first, and by
            signature.
        todo: next steps, each a sentence and the command.
    """

    title: str
    runs: tuple[Manifest, ...]
    causes: tuple[CauseList, ...] = ()
    failures: tuple[DescribedFailure, ...]
    todo: tuple[tuple[str, str], ...] = ()


def listing_of(source: pathlib.Path) -> Listing:
    """The failures of a store or corpus."""
    source = locate(source)
    if source.is_dir():
        return listing_of_corpus(source, read_corpus(source))
    with Store.open(source) as store:
        return listing_of_store(store)


def listing_of_corpus(folder: pathlib.Path, corpus: Corpus) -> Listing:
    """The cases of a corpus."""
    cases = (described_case(folder, corpus, case) for case in corpus.cases)
    return Listing(title=title_of(corpus.runs), runs=tuple(corpus.runs), failures=_in_order(cases))


def listing_of_store(store: Store) -> Listing:
    """The failures of a store, with the results of triage."""
    runs, causes = store.runs(), all_causes(store)
    manifests = tuple(run.manifest for run in runs)
    return Listing(
        title=title_of(manifests),
        runs=manifests,
        causes=causes,
        failures=_causes_first(store, causes, runs),
        todo=_todo(store, causes, manifests),
    )


def failures_of(store: Store, run: int | None = None) -> Iterator[DescribedFailure]:
    """Each failure of a store, or of a run in it, in the order of proposals."""
    triaged = {row.key: row for row in store.triaged()}
    manifests = {one.id: one.manifest for one in store.runs()}
    for finding in store.findings(run):
        one = described(store.path, finding, manifests[finding.run], triaged.get(finding.key))
        outcome = store.known(finding.scene, finding.policy_key) if finding.scene.events else None
        early = outcome is not None and failed_before(finding.scene, outcome)
        yield replace(one, before_event=1) if early else one


def _causes_first(store: Store, lists: Sequence[CauseList], runs: Sequence[Run]) -> tuple[DescribedFailure, ...]:
    """The failures of causes, in the order of their lists, then the others; those with one minimal scene are one."""
    policy = {run.id: run.manifest.key() for run in runs}
    found = [(digest, policy[one.run]) for one in lists for cause in one.causes for digest in cause.found]
    ranks = {key: rank for rank, key in reversed(list(enumerate(found)))}
    merged: dict[tuple[str, str, str], DescribedFailure] = {}  # by minimal scene
    for one in failures_of(store):
        key = (one.scene.digest, one.run.key(), one.bucket)
        if before := merged.get(key):
            one = replace(before, found=before.found + one.found, before_event=before.before_event + one.before_event)
        merged[key] = one
    in_order = _in_order(merged.values())
    return tuple(sorted(in_order, key=lambda one: min(ranks.get((name, one.run.key()), inf) for name in one.found)))


def _in_order(failures: Iterable[DescribedFailure]) -> tuple[DescribedFailure, ...]:
    """Failures by evidence, the most first, then by the frequency of the signature."""
    failures = list(failures)
    counts = Counter(one.signature for one in failures)
    frequent = sorted(failures, key=lambda one: (-counts[one.signature], one.signature or ""))
    return tuple(sorted(frequent, key=lambda one: BUCKETS.index(one.bucket)))


def _todo(store: Store, causes: Sequence[CauseList], runs: Sequence[Manifest]) -> tuple[tuple[str, str], ...]:
    """What to triage, unless every run found causes, and all of them are triaged."""
    buckets = {cause.bucket for one in causes for cause in one.causes}
    explained = len(causes) == len(runs) and all(one.causes for one in causes) and "observed" not in buckets
    found = {finding.key for finding in store.findings()}
    left = len(found - {row.key for row in store.triaged()})
    if explained or not left:
        return ()
    triage = command("triage", store.path, names=[name for run in runs for name in (run.policy, run.task)])
    untriaged = f"{plural(left, 'finding')} {'is' if left == 1 else 'are'} not triaged yet"
    return ((f"{untriaged}. Triage confirms findings and names their causes{hours(store, left)}:", triage),)
