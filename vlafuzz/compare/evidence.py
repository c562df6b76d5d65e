"""How far what a strategy finds can be trusted, and how many bugs it is: failures of a sample, triaged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vlafuzz.compare.solvable import Sampled
from vlafuzz.statistics import share_interval
from vlafuzz.store.records import Finding, Triaged
from vlafuzz.store.store import Store


@dataclass(frozen=True)
class Evidence:
    """What triage made of a sample of failures.

    Attributes:
        triaged: of the sample; those that could not be judged are not.
        confirmed: failed again, ``low`` and ``high`` the 95 % interval of their share over the runs.
        witnessed: of these, solved by the expert.
        minimal: of these, every operator left in it matters.
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
    """At most so many of a sample, those that the expert solves first: only they are shrunk.

    Args:
        solved: by digest, whether it does.
    """
    return sorted(sampled, key=lambda each: not solved.get(each.scene.digest))[:size]


def findings(store: Store, chosen: Sequence[Sampled]) -> dict[Sampled, Finding]:
    """What a store has of some failures: a run may have found what another had found before."""
    runs = {each.run for each in chosen}
    known = {Sampled(each.scene, run): each for run in runs for each in store.findings(run)}
    return {each: known[each] for each in chosen}


def evidence(found: Mapping[Sampled, Finding], triaged: Iterable[Triaged]) -> Evidence | None:
    """What triage has made of some findings; None where it has judged none of them."""
    known = {(each.scene, each.policy_key): each for each in triaged}
    made = [(each.run, known.get((finding.scene, finding.policy_key))) for each, finding in found.items()]
    judged = [each for _, each in made if each]
    if not judged:
        return None
    confirmed = [(run, each.bucket != "flaky") for run, each in made if each]
    bugs = {each.signature for each in judged if each.signature and each.bucket != "base"}
    return Evidence(
        len(judged),
        sum(so for _, so in confirmed),
        *share_interval(confirmed),
        witnessed=sum(each.witness is not None for each in judged),
        minimal=sum(each.bucket == "minimal" for each in judged),
        signatures=len(bugs),
    )
