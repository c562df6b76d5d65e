"""Bundle: an exported corpus as values: minimal failing scenes, each with what makes it trustworthy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vlafuzz.evidence import Causes, Witness
from vlafuzz.scene import Scene
from vlafuzz.statistics import wilson
from vlafuzz.store.records import Manifest

SCHEMA = 2  # of the folder, described in corpus/README.md


@dataclass(frozen=True, eq=False)
class Case:
    """One failure.

    Attributes:
        scene: minimal: each operator in it that is not nominal is needed for the policy to fail.
        lost_stage: the stage that the policy does not reach.
        operators: not nominal in the scene, the confounders' as one.
        counterparts: by operator, the scene without it, in which the policy passes.
        nominal: the scene without any of them, the control; ``nominal_passes`` is what came of it.
        witness: a solution of the scene.
        found: digest of the scene as it was found.
        run: number of the run that found it, in ``Bundle.runs``.
        repeats: that confirmed it, ``failures`` of them failed.
        rollouts: of the policy, to shrink and attribute it.
        thumbnail: PNG of the scene as the third-person camera sees it; None where nothing could be rendered.
    """

    scene: Scene
    lost_stage: str
    signature: str
    operators: tuple[str, ...]
    causes: Causes
    counterparts: Mapping[str, Scene]
    nominal: Scene
    nominal_passes: bool
    witness: Witness
    found: str
    run: int
    repeats: int
    failures: int
    rollouts: int
    thumbnail: bytes | None = None

    @property
    def title(self) -> str:
        """What it takes, in a few words: the thresholds where they are known, else the operators."""
        said = {threshold.operator: str(threshold) for threshold in self.causes.thresholds}
        return "; ".join(said.get(name, name) for name in self.operators)


@dataclass(frozen=True)
class Share:
    """A count of so many, with its 95 % interval (Wilson)."""

    count: int
    of: int
    low: float
    high: float

    @staticmethod
    def of_counts(count: int, of: int) -> Share:
        """The interval of nothing is everything."""
        return Share(count, of, *(wilson(count, of) if of else (0.0, 1.0)))


@dataclass(frozen=True)
class Evidence:
    """What triage of the stores came to, and what was written of it.

    Attributes:
        findings: of the stores.
        shares: of those that were triaged: confirmed, flaky, witnessed, unproven, base, minimal.
        left_out: minimal findings that are not in here, by reason.
        search_rollouts: of the policy, to find them; ``triage_rollouts`` to triage them.
        expert_rollouts: replays of witnesses included.
        seconds: wall time of triage.
    """

    findings: int
    shares: Mapping[str, Share]
    left_out: Mapping[str, int]
    search_rollouts: int
    triage_rollouts: int
    expert_rollouts: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Corpus:
    """All of it.

    Attributes:
        runs: that found the cases: policy, versions, conditions.
        renderer: what drew the pictures when the cases were confirmed; None for a policy that sees none.
        versions: of the packages then.
        created: ISO 8601, UTC.
    """

    name: str
    runs: Sequence[Manifest]
    cases: Sequence[Case]
    evidence: Evidence
    renderer: str | None
    versions: Mapping[str, str] = field(default_factory=dict)
    created: str = ""

    @property
    def task(self) -> str:
        """Of all scenes."""
        return self.runs[0].task

    @property
    def policy(self) -> str:
        """Which failed, as its user named it."""
        return self.runs[0].policy

    def seed(self, case: Case) -> int:
        """Of the rollouts in which it failed."""
        return self.runs[case.run].seed
