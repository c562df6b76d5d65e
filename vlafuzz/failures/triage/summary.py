"""TriageSummary: a store's findings after triage in numbers, the JSON of ``triage --json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import get_args

from vlafuzz.model.evidence import Rate
from vlafuzz.model.phrasing import describe
from vlafuzz.store.records import Bucket, Triaged
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class TriagedFinding:
    """One finding after triage, in names and sentences; scenes are digests.

    Attributes:
        scene: the finding; ``shrunk`` is the scene that is left of it.
        rate: how often the policy fails around the finding; ``certified``: around ``shrunk``. reference: the passing
        scene that it was shrunk to; None for the nominal one.
        causes: the thresholds that were located, from which on operators make the policy fail. solver: see ``Witness``;
        None without a witness.
    """

    scene: str
    bucket: str
    signature: str | None
    shrunk: str | None
    reference: str | None
    necessary: tuple[str, ...]
    sufficient: tuple[str, ...]
    causes: tuple[str, ...]
    failures: int
    repeats: int
    rate: Rate | None
    certified: Rate | None
    shrink_rollouts: int
    solver: str | None
    detail: str

    @staticmethod
    def of(triaged: Triaged) -> TriagedFinding:
        same = ("bucket", "signature", "failures", "repeats", "shrink_rollouts", "detail")
        return TriagedFinding(
            **{name: getattr(triaged, name) for name in same},
            scene=triaged.scene.digest,
            rate=triaged.rate,
            certified=triaged.certified,
            shrunk=triaged.shrunk.digest if triaged.shrunk else None,
            reference=triaged.reference.digest if triaged.reference else None,
            solver=triaged.witness.solver if triaged.witness else None,
            necessary=triaged.causes.necessary,
            sufficient=triaged.causes.sufficient,
            causes=tuple(map(describe, triaged.causes.thresholds)),
        )


@dataclass(frozen=True, kw_only=True)
class TriageSummary:
    """All findings of a store that were triaged, in numbers.

    Attributes:
        findings: of the store, of which ``triaged`` were triaged.
        confirmed: findings that fail again in their neighbourhood: all that are not flaky. witnessed:
        confirmed findings that the expert solved; ``by_sight``: those that the seeing expert did. distinct_cells: cells
        in which the findings lie, before triage.
        signatures: findings by signature, after triage.
        deviating_before: operators that were not nominal, median over the shrunk findings. deviating_after: operators
        left; ``shrink_rollouts``: medians over the same. policy_rollouts: all rollouts to confirm, shrink and
        attribute.
        expert_rollouts: all rollouts of the expert, replays included.
        triaged_findings: in the order in which they were triaged.
    """

    store: str
    findings: int
    triaged: int
    buckets: dict[str, int]
    confirmed: int
    witnessed: int
    by_sight: int
    distinct_cells: int
    distinct_signatures: int
    signatures: dict[str, int]
    deviating_before: float | None
    deviating_after: float | None
    shrink_rollouts: float | None
    policy_rollouts: int
    expert_rollouts: int
    seconds: float
    triaged_findings: tuple[TriagedFinding, ...]


def summarise(store: Store, task: str | None = None) -> TriageSummary:
    """Count what triage of a store, or of one task in it, has come to so far."""
    findings = [one for one in store.findings() if task in (None, one.scene.task)]
    triaged = [one for one in store.triaged() if task in (None, one.scene.task)]
    witnesses = [finding.witness for finding in triaged if finding.witness]
    buckets = Counter(finding.bucket for finding in triaged)
    shrunk = [finding for finding in triaged if finding.shrunk]
    signatures = Counter(finding.signature for finding in shrunk if finding.signature)
    return TriageSummary(
        store=str(store.path),
        findings=len(findings),
        triaged=len(triaged),
        buckets={name: buckets[name] for name in get_args(Bucket)},
        confirmed=len(triaged) - buckets["flaky"],
        witnessed=len(witnesses),
        by_sight=sum(witness.solver == "seeing" for witness in witnesses),
        distinct_cells=len({(finding.scene.task, finding.cell) for finding in findings}),
        distinct_signatures=len(signatures),
        signatures=dict(signatures.most_common()),
        deviating_before=_median([len(finding.deviating) for finding in shrunk]),
        deviating_after=_median([len(finding.operators) for finding in shrunk]),
        shrink_rollouts=_median([finding.shrink_rollouts for finding in shrunk]),
        policy_rollouts=sum(finding.policy_rollouts for finding in triaged),
        expert_rollouts=sum(finding.expert_rollouts for finding in triaged),
        seconds=sum(finding.seconds for finding in triaged),
        triaged_findings=tuple(map(TriagedFinding.of, triaged)),
    )


def _median(numbers: Sequence[int]) -> float | None:
    return float(median(numbers)) if numbers else None
