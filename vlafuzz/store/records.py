"""The contents of a store as values: runs with their manifests, trials, findings."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from pydantic import InstanceOf

from vlafuzz.model import Conditions, Failure, Kept, Mechanism, Outcome, Rate, Scene, Verdict, Witness
from vlafuzz.model.conditions import Origin, Role, condition
from vlafuzz.search.base import Genome
from vlafuzz.search.probability import Probability

Status = Literal["running", "finished", "stopped", "interrupted", "failed"]
UNFINISHED: tuple[Status, ...] = ("running", "interrupted", "failed")  # a killed run says running
Bucket = Literal["minimal", "witnessed", "unproven", "flaky"]


@dataclass(frozen=True, kw_only=True)
class Manifest(Conditions):
    """Everything needed to repeat a run: its conditions, what searched, and where it comes from.

    Attributes:
        budget: in policy rollouts.
        batch: proposals that are asked for at once.
        versions: of the packages that matter, by name.
        command: the command line that began the run.
        checkup: result of the policy's check before the run: ``ok``, ``unchecked`` or what is wrong with it; empty
            where it was not checked.
    """

    strategy: str = condition(Role.SEARCH, Origin.FLAG)
    budget: int = condition(Role.SEARCH, Origin.FLAG)
    batch: int = condition(Role.SEARCH, Origin.FLAG)
    versions: Mapping[str, str] = field(default_factory=dict)
    command: str = ""
    checkup: str = ""


@dataclass(frozen=True, kw_only=True)
class Run:
    """One campaign, with its wall time in ``seconds`` once it is over; a killed run stays ``running``."""

    id: int
    manifest: Manifest
    status: Status
    seconds: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One proposal of a run with its outcome.

    Attributes:
        cell: where its failure lies; None unless FAILED.
        duplicate: answered with a known outcome; nothing was run for it, and it has no rollouts of its own.
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
    """A failing scene that is kept, once for each policy key. ``run`` saw it first."""

    scene: Scene
    policy_key: str
    run: int
    cell: str

    @property
    def key(self) -> tuple[str, str]:
        """Digest of the scene and policy key, which a finding shares with what triage made of it."""
        return self.scene.digest, self.policy_key


@dataclass(frozen=True)
class FoundCause:
    """A cause that a run's strategy has found; triage of its scene confirms and certifies it.

    Attributes:
        scene: fails for this reason in the run; None if no stored failure has its operators alone.
        operators: that it takes, the confounders' as one.
        failures: of the run that it explains.
        share: of random scenes that fail for this reason; None if unknown.
        mechanism: the quantity through which this cause and others act, of which it is the one that explains most
            failures; failures and share are those of all.
        tests: of the run, which certify it, too: see ``search.base.Cause``.
    """

    scene: Scene | None
    operators: tuple[str, ...]
    failures: int
    share: Probability | None = None
    mechanism: Mechanism | None = None
    tests: Mapping[str, tuple[bool, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Attribution:
    """The causes that a run has found, in order of rank.

    Attributes:
        unexplained: failures of the run for which no cause was found.
        probability: that the policy fails in a random scene; None if the strategy does not estimate it.
        at_random: the proposals that are random scenes, which passed or failed.
    """

    causes: tuple[FoundCause, ...]
    unexplained: int = 0
    probability: Probability | None = None
    at_random: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Triaged(Failure):
    """A finding after triage.

    Attributes:
        bucket: ``minimal``; ``witnessed``, but not shown to be minimal, ``detail`` says why; ``unproven``, the
            expert fails, too; ``flaky``, it is not shown to fail more often than the nominal scene.
        rate: of the finding; None in findings of earlier versions.
        reference: a scene of the same objects that passes, to which the finding was shrunk since the nominal one fails,
            too; None where that was the nominal scene.
        deviating: operators that were not nominal, the confounders' as one.
        shrunk: the scene that is left; None where it was not shrunk.
        counterparts: by operator left, the scene without it, in which the policy passes.
        witness: a solution of ``shrunk`` where the finding is ``minimal``, else of the finding.
        shrink_rollouts: of the policy, to shrink and attribute; ``policy_rollouts`` are all of them.
    """

    scene: Kept
    policy_key: str
    bucket: Bucket
    deviating: tuple[str, ...]
    rate: Rate | None = None
    reference: Kept | None = None
    shrunk: Kept | None = None
    counterparts: Mapping[str, Kept] = field(default_factory=dict)
    witness: InstanceOf[Witness] | None = None
    shrink_rollouts: int = 0
    policy_rollouts: int = 0
    expert_rollouts: int = 0
    seconds: float = 0.0
    detail: str = ""

    @property
    def key(self) -> tuple[str, str]:
        """See ``Finding.key``."""
        return self.scene.digest, self.policy_key


class Judged(NamedTuple):
    """The verdict of one rollout.

    Attributes:
        lost: the stage that was lost, if it failed.
        rollouts: that it took: none where the scene is not fair.
        unanswered: the policy did not answer.
    """

    verdict: Verdict
    lost: str | None = None
    rollouts: int = 0
    unanswered: bool = False

    @staticmethod
    def of(outcome: Outcome) -> "Judged":
        """The verdict of an outcome. A crash counts as a rollout."""
        spent = max(len(outcome.rollouts), int(outcome.verdict is Verdict.ERROR))
        return Judged(outcome.verdict, outcome.lost_stage, spent, outcome.unanswered)


Repeats = dict[tuple[str, int], Judged]
"""Rollouts of triage by the scene's digest and their number, which jitter and seed depend on."""
