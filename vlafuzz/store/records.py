"""What a store holds, as values: runs with their manifest, trials, findings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal, NamedTuple

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

# What flags give, by the name that they have there, too.
FLAGS = (
    "task", "robot", "policy", "strategy", "budget", "seed", "batch", "repeats", "stop_early", "criteria",
    "placement",
)  # fmt: skip
# What a scene's outcome depends on, beside the scene. Budget, batch and strategy only say which are tried.
_DECISIVE = (
    "policy", "spec", "seed", "repeats", "criteria", "placement", "stop_early", "min_distance",
    "catalogue_digest", "simulator", "commit",
)  # fmt: skip


_OLD = {"policy": "subject"}  # in keys, so that existing stores still answer


@dataclass(frozen=True)
class Manifest:
    """Everything needed to do a run again.

    Attributes:
        policy: as the user named it; ``spec`` is its own description, as JSON.
        budget: in policy rollouts.
        repeats: rollouts a scene.
        operators: the operators with their ranges, as JSON.
        min_distance: between objects, metres.
        packs: of objects, as JSON: name, digest, and the folder in which each was; the catalogue's digest has
            their content.
        simulator: name and version of what the scenes are run in.
        versions: of the packages that matter, by name.
        commit: of vlafuzz's checkout, if it is one.
        checkup: of the policy before the run: ``ok``, ``unchecked`` or what is wrong with it; empty where
            nobody asked.
        given: the file of scenes that the run had or chose from, as JSON (see ``given``); empty for none.
        source: digest of the user's own code that makes the policy; empty for others.
    """

    task: str
    policy: str
    spec: str
    strategy: str
    budget: int
    batch: int
    seed: int
    repeats: int = 1
    criteria: str = "strict"
    placement: str = "resting"
    stop_early: bool = False
    min_distance: float = 0.0
    operators: str = "{}"
    operators_digest: str = ""
    catalogue_digest: str = ""
    packs: str = "[]"
    robot: str = "panda"
    simulator: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    commit: str | None = None
    command: str = ""
    checkup: str = ""
    given: str = ""
    source: str = ""

    @property
    def pool(self) -> str | None:
        """Digest of the scenes from which the strategy chose; None where it made its own."""
        mark = json.loads(self.given or "{}")
        return mark["digest"] if mark.get("flag") == "pool" else None

    @property
    def conditions(self) -> tuple[object, ...]:
        """What else than strategy and seed a share of failures depends on: where equal, runs compare."""
        decisive = (getattr(self, name) for name in _DECISIVE if name != "seed")
        return (self.task, self.robot, self.operators_digest, self.pool, self.source, *decisive)

    @property
    def policy_key(self) -> str:
        """The policy and all else that an outcome depends on: within one key, a store answers for it."""
        values = asdict(self)
        names = (*_DECISIVE, "source") if self.source else _DECISIVE  # earlier stores have no such thing
        decisive = json.dumps({_OLD.get(name, name): values[name] for name in names}, sort_keys=True)
        return f"{self.policy}:{hashlib.blake2b(decisive.encode(), digest_size=6).hexdigest()}"


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
