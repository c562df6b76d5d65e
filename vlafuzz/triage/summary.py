"""Harvest: what triage of a store has come to, the JSON of ``triage --json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import get_args

from vlafuzz.store.records import Bucket, Triaged
from vlafuzz.store.store import Store


@dataclass(frozen=True)
class TriagedFinding:
    """One finding after triage, in names and sentences. Scenes are digests.

    Attributes:
        scene: the finding; ``shrunk`` what is left of it.
        causes: from where on its operators make the policy fail.
    """

    scene: str
    bucket: str
    signature: str | None
    shrunk: str | None
    necessary: tuple[str, ...]
    sufficient: tuple[str, ...]
    causes: tuple[str, ...]
    failures: int
    repeats: int
    shrink_rollouts: int
    detail: str

    @staticmethod
    def of(triaged: Triaged) -> TriagedFinding:
        """What there is to say about it."""
        return TriagedFinding(
            triaged.scene.digest,
            triaged.bucket,
            triaged.signature,
            triaged.shrunk.digest if triaged.shrunk else None,
            triaged.causes.necessary,
            triaged.causes.sufficient,
            tuple(map(str, triaged.causes.thresholds)),
            triaged.failures,
            triaged.repeats,
            triaged.shrink_rollouts,
            triaged.detail,
        )


@dataclass(frozen=True)
class TriageSummary:
    """All that was triaged in a store, in numbers.

    Attributes:
        findings: of the store, ``triaged`` of them.
        buckets: findings by bucket.
        confirmed: failed again: all that are not flaky.
        witnessed: of these, solved by the expert.
        distinct_cells: in which the findings lie, before triage.
        signatures: findings by bug, after triage; without ``base``.
        deviating_before: operators that were not nominal, median over those that were shrunk.
        deviating_after: operators left in them.
        shrink_rollouts: median over those that were shrunk.
        policy_rollouts: all, to confirm, shrink and attribute.
        expert_rollouts: all, replays included.
        seconds: wall time of it.
        crops: one a finding, in the order in which they were triaged.
    """

    store: str
    findings: int
    triaged: int
    buckets: dict[str, int]
    confirmed: int
    witnessed: int
    distinct_cells: int
    distinct_signatures: int
    signatures: dict[str, int]
    deviating_before: float | None
    deviating_after: float | None
    shrink_rollouts: float | None
    policy_rollouts: int
    expert_rollouts: int
    seconds: float
    crops: tuple[TriagedFinding, ...]


def summarise(store: Store) -> TriageSummary:
    """Count what is there."""
    findings, triaged = store.findings(), store.triaged()
    buckets = Counter(each.bucket for each in triaged)
    shrunk = [each for each in triaged if each.shrunk and each.bucket != "base"]
    bugs = Counter(each.signature for each in shrunk if each.signature)
    return TriageSummary(
        store=str(store.path),
        findings=len(findings),
        triaged=len(triaged),
        buckets={name: buckets[name] for name in get_args(Bucket)},
        confirmed=len(triaged) - buckets["flaky"],
        witnessed=sum(each.witness is not None for each in triaged),
        distinct_cells=len({finding.cell for finding in findings}),
        distinct_signatures=len(bugs),
        signatures=dict(bugs.most_common()),
        deviating_before=_median([len(each.deviating) for each in shrunk]),
        deviating_after=_median([len(each.operators) for each in shrunk]),
        shrink_rollouts=_median([each.shrink_rollouts for each in shrunk]),
        policy_rollouts=_total(triaged, "policy_rollouts"),
        expert_rollouts=_total(triaged, "expert_rollouts"),
        seconds=sum(each.seconds for each in triaged),
        crops=tuple(map(TriagedFinding.of, triaged)),
    )


def _median(numbers: Sequence[int]) -> float | None:
    return float(median(numbers)) if numbers else None


def _total(triaged: Sequence[Triaged], name: str) -> int:
    return sum(getattr(each, name) for each in triaged)
