"""TriageSummary: a store's findings after triage in numbers, the JSON of ``triage --json``."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import get_args

from vlafuzz.store.records import Bucket
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class TriageSummary:
    """All findings of a store that were triaged, in numbers.

    Attributes:
        findings: of the store, of which ``triaged`` were triaged.
        confirmed: findings that fail again in their neighbourhood: all that are not flaky. witnessed: confirmed ones
        that the expert solved; ``by_sight``: those that the seeing expert did.
        signatures: findings by signature, after triage.
        policy_rollouts: all rollouts to confirm, shrink and attribute. expert_rollouts: replays included.
    """

    store: str
    findings: int
    triaged: int
    buckets: dict[str, int]
    confirmed: int
    witnessed: int
    by_sight: int
    distinct_signatures: int
    signatures: dict[str, int]
    policy_rollouts: int
    expert_rollouts: int
    seconds: float


def summarise(store: Store, task: str | None = None) -> TriageSummary:
    """Count what triage of a store, or of one task in it, has come to so far."""
    findings = [one for one in store.findings() if task in (None, one.scene.task)]
    triaged = [one for one in store.triaged() if task in (None, one.scene.task)]
    witnesses = [finding.witness for finding in triaged if finding.witness]
    buckets = Counter(finding.bucket for finding in triaged)
    signatures = Counter(finding.signature for finding in triaged if finding.shrunk and finding.signature)
    return TriageSummary(
        store=str(store.path),
        findings=len(findings),
        triaged=len(triaged),
        buckets={name: buckets[name] for name in get_args(Bucket)},
        confirmed=len(triaged) - buckets["flaky"],
        witnessed=len(witnesses),
        by_sight=sum(witness.solver == "seeing" for witness in witnesses),
        distinct_signatures=len(signatures),
        signatures=dict(signatures.most_common()),
        policy_rollouts=sum(finding.policy_rollouts for finding in triaged),
        expert_rollouts=sum(finding.expert_rollouts for finding in triaged),
        seconds=sum(finding.seconds for finding in triaged),
    )
