"""How far the failures of a strategy can be trusted, and how many bugs they are: triage of a sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.compare.solvable import Sampled
from vlafuzz.statistics import share_interval
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The triage results of a sample of failures.

    Attributes:
        triaged: failures of the sample that could be judged.
        confirmed: failed again; ``low`` and ``high`` are the 95 % interval of their share over the runs.
        witnessed: of these, solved by the expert.
        minimal: of these, those in which every remaining operator is necessary.
        signatures: distinct bugs, without those that fail at nominal.
    """

    triaged: int
    confirmed: int
    low: float
    high: float
    witnessed: int
    minimal: int
    signatures: int


def choose(sampled: Sequence[Sampled], solved: Mapping[str, bool], size: int) -> list[Sampled]:
    """At most ``size`` failures of a sample, those that the expert solves first: only these are shrunk.

    Args:
        solved: by digest, whether the expert solves the scene.
    """
    return sorted(sampled, key=lambda failure: not solved.get(failure.scene.digest))[:size]


def findings(store: Store, chosen: Sequence[Sampled]) -> dict[Sampled, Finding]:
    """The stored findings of some failures, which other runs may have found first."""
    runs = {failure.run for failure in chosen}
    known = {Sampled(finding.scene, run): finding for run in runs for finding in store.findings(run)}
    return {failure: known[failure] for failure in chosen}


def evidence(chosen: Mapping[Sampled, Finding], triaged: Iterable[Triaged]) -> Evidence | None:
    """The triage results of some findings; None if none of them was judged."""
    by_key = {result.key: result for result in triaged}
    runs = [(failure.run, by_key.get(finding.key)) for failure, finding in chosen.items()]
    judged = [result for _, result in runs if result]
    if not judged:
        return None
    confirmed = [(run, result.bucket != "flaky") for run, result in runs if result]
    bugs = {result.signature for result in judged if result.signature and result.bucket != "base"}
    low, high = share_interval(confirmed)
    return Evidence(
        triaged=len(judged),
        confirmed=sum(positive for _, positive in confirmed),
        low=low,
        high=high,
        witnessed=sum(result.witness is not None for result in judged),
        minimal=sum(result.bucket == "minimal" for result in judged),
        signatures=len(bugs),
    )
