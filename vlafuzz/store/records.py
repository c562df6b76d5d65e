"""What a store holds, as values: runs with their manifest, trials, findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from vlafuzz.conditions.conditions import Conditions, Origin, Role, condition
from vlafuzz.evidence import Causes, Witness
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.search.base import Genome

Status = Literal["running", "finished", "stopped", "interrupted", "failed"]
UNFINISHED: tuple[Status, ...] = ("running", "interrupted", "failed")  # a killed run says running
EVIDENCE = ("observed", "confirmed", "witnessed", "minimal")  # from the least to the most
Bucket = Literal["minimal", "witnessed", "base", "unproven", "flaky"]
# How far the evidence goes for a finding that triage left in a bucket.
EVIDENCE_OF: Mapping[Bucket, str] = {
    "minimal": "minimal",
    "witnessed": "witnessed",
    "base": "witnessed",
    "unproven": "confirmed",
    "flaky": "observed",
}


@dataclass(frozen=True, kw_only=True)
class Manifest(Conditions):
    """Everything needed to repeat a run: its conditions, what searched, and where it comes from.

    Attributes:
        budget: in policy rollouts.
        batch: proposals that are asked for at once.
        versions: of the packages that matter, by name.
        command: the command line that began the run.
        checkup: result of the policy's check before the run: ``ok``, ``unchecked`` or what is wrong with it;
            empty where it was not checked.
    """

    strategy: str = condition(Role.SEARCH, Origin.FLAG)
    budget: int = condition(Role.SEARCH, Origin.FLAG)
    batch: int = condition(Role.SEARCH, Origin.FLAG)
    versions: Mapping[str, str] = field(default_factory=dict)
    command: str = ""
    checkup: str = ""


class Spent(NamedTuple):
    """Seconds of wall time: all, and of these those in the strategy's ask and tell, and in the store."""

    seconds: float
    search: float | None = None
    store: float | None = None


@dataclass(frozen=True)
class Run:
    """One campaign. ``started`` and ``ended`` are ISO 8601, UTC; a killed run says ``running`` for ever.

    Attributes:
        seconds: wall time; ``search_seconds`` of it in the strategy's ask and tell, ``store_seconds`` in the
            store. Both are None in runs of earlier versions.
    """

    id: int
    manifest: Manifest
    status: Status
    started: str
    ended: str | None = None
    seconds: float | None = None
    search_seconds: float | None = None
    store_seconds: float | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """One proposal of a run with its outcome.

    Attributes:
        cell: where its failure lies; None unless FAILED.
        duplicate: answered with a known outcome; nothing was run for it, and no rollouts are kept with it.
    """

    proposal: int
    scene: Scene
    outcome: Outcome
    severity: float
    genome: Genome | None = None
    cell: str | None = None
    duplicate: bool = False


@dataclass(frozen=True)
class Finding:
    """A failing scene that is kept, once for each policy key. ``run`` and ``proposal`` saw it first."""

    scene: Scene
    policy_key: str
    run: int
    proposal: int
    evidence: str
    cell: str


@dataclass(frozen=True, eq=False)
class Triaged:
    """What triage made of a finding.

    Attributes:
        bucket: ``minimal``; ``witnessed``, but not shown to be minimal, ``detail`` says why; ``base``, even
            the nominal scene fails; ``unproven``, the expert fails, too; ``flaky``, it does not mostly fail.
        repeats: that confirmed it or did not, ``failures`` of them failed.
        deviating: operators that were not nominal, the confounders' as one.
        shrunk: what is left of the scene; None where it was not shrunk.
        lost_stage: in what is left.
        operators: left in it.
        counterparts: by operator left, the scene without it, in which the policy passes.
        unresolved: operators left without a counterpart.
        signature: which bug it is.
        witness: of what is left when it is ``minimal``, else of the finding.
        complete: the bound on rollouts cut nothing short.
        shrink_rollouts: of the policy, to shrink and attribute; ``policy_rollouts`` are all.
    """

    scene: Scene
    policy_key: str
    bucket: Bucket
    repeats: int
    failures: int
    deviating: tuple[str, ...]
    shrunk: Scene | None = None
    lost_stage: str | None = None
    operators: tuple[str, ...] = ()
    causes: Causes = field(default_factory=Causes)
    counterparts: Mapping[str, Scene] = field(default_factory=dict)
    unresolved: tuple[str, ...] = ()
    signature: str | None = None
    witness: Witness | None = None
    complete: bool = True
    shrink_rollouts: int = 0
    policy_rollouts: int = 0
    expert_rollouts: int = 0
    seconds: float = 0.0
    detail: str = ""

    @property
    def evidence(self) -> str:
        """How far it goes, one of ``EVIDENCE``."""
        return EVIDENCE_OF[self.bucket]
