"""An exported corpus as values: minimal failing scenes, each with the evidence for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import ConfigDict

from vlafuzz.model import Causes, Failure, Kept, Model, Witness
from vlafuzz.model.phrasing import titled
from vlafuzz.store.records import Manifest

SCHEMA = 3  # of the folder, described in corpus/README.md


@dataclass(frozen=True, eq=False, kw_only=True)
class Facts(Failure):
    """A failure without its witness: what the manifest of a folder holds, scenes by their digests.

    Attributes:
        scene: minimal: the policy needs every one of ``operators`` to fail.
        counterparts: by operator, the scene with this operator reset, in which the policy passes.
        nominal: the scene with all operators reset.
        reference: the passing scene that the failure was shrunk to, where the policy does not pass in the nominal one;
            resetting an operator takes its values from there. None: the nominal scene.
        nominal_passes: verdict of the nominal scene.
        found: digest of the scene as the search found it.
        run: index of the run that found it, in ``Corpus.runs``.
        rollouts: of the policy, to shrink and attribute the finding.
    """

    lost_stage: str
    signature: str
    operators: tuple[str, ...]
    causes: Causes
    scene: Kept
    counterparts: Mapping[str, Kept]
    nominal: Kept
    reference: Kept | None = None
    nominal_passes: bool
    found: str
    run: int
    rollouts: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Case(Facts):
    """One failure; ``witness`` is a solution of its scene."""

    witness: Witness

    @property
    def title(self) -> str:
        """The operators in a few words, with their thresholds where these are known."""
        return titled(self.operators, self.causes)


@dataclass(frozen=True)
class Control:
    """A random scene, which no outcome selected, and whether the corpus's own policy passed in it."""

    __pydantic_config__ = ConfigDict(extra="forbid")
    scene: Kept
    passed: bool


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Says how many rollouts the corpus took, and what the export left out.

    Attributes:
        left_out: number of minimal findings that are not in the corpus, by reason.
        search_rollouts: policy rollouts of the search; ``triage_rollouts``: those of triage.
        expert_rollouts: replays of witnesses included.
    """

    __pydantic_config__ = ConfigDict(extra="ignore")  # of earlier versions
    left_out: Mapping[str, int]
    search_rollouts: int
    triage_rollouts: int
    expert_rollouts: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Corpus:
    """All cases of one policy on one task, and where they come from.

    Attributes:
        runs: the runs that found the cases: policy, versions, conditions.
        controls: drawn and run under the conditions of the first run; none in corpora of schema 2 and before.
        renderer: what rendered the policy's images when the cases were checked; None for a policy without cameras.
        versions: of the packages at that time.
        created: ISO 8601, UTC.
    """

    name: str
    runs: Sequence[Manifest]
    cases: Sequence[Case]
    evidence: Evidence
    renderer: str | None
    controls: Sequence[Control] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    created: str = ""

    @property
    def task(self) -> str:
        return self.runs[0].task

    @property
    def policy(self) -> str:
        """The policy that failed, as the user named it."""
        return self.runs[0].policy

    @property
    def tested(self) -> Model:
        """The model that failed."""
        return self.runs[0].tested
