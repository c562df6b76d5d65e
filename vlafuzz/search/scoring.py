"""Scores of outcomes for strategies, and the cells of failures."""

import math
from dataclasses import dataclass

import numpy as np

from vlafuzz.model import Outcome, Rollout, Scene, Space, Verdict


@dataclass(frozen=True)
class Score:
    """The feedback on a proposal for its strategy.

    Attributes:
        progress: of the worst rollout, in [0, 1]; None without a judgement of the policy (INVALID, ERROR).
        severity: the scene's distance from nominal.
        slack: how early the slowest rollout succeeded, in (0, 1]; 0 unless PASSED.
        cell: a coarse, readable location of a failure, ``grasp|camera-position+light|x0y3``: the lost stage and the
            scene's ``site``. Failures in one cell often have the same cause. None unless FAILED.
    """

    verdict: Verdict
    progress: float | None
    severity: float
    slack: float = 0.0
    cell: str | None = None

    @property
    def failed(self) -> bool:
        return self.verdict is Verdict.FAILED

    @property
    def lost(self) -> str | None:
        """The stage that a failure lost, as its cell says it; None unless FAILED."""
        return (self.cell or "").partition("|")[0] if self.failed else None

    @property
    def rolled_out(self) -> bool:
        """Whether the verdict is about the policy."""
        return self.verdict >= Verdict.PASSED

    @property
    def ease(self) -> float:
        """How far the scene is from an early failure of the policy, in [0, 2]; infinite if not judged.

        Failures rank before passes and by progress; passes rank by their time of success, as a policy that succeeds
        late is assumed to be close to failing.
        """
        return math.inf if self.progress is None else self.progress + self.slack


def score(scene: Scene, outcome: Outcome, space: Space) -> Score:
    """How a scene ended, as strategies are told."""
    severities = space.severities(scene)
    known = outcome.judged and math.isfinite(outcome.progress)
    passed, failed = outcome.verdict is Verdict.PASSED, outcome.verdict is Verdict.FAILED
    return Score(
        verdict=outcome.verdict,
        progress=outcome.progress if known else None,
        severity=space.severity(scene),
        slack=min(map(_slack, outcome.rollouts), default=0.0) if passed else 0.0,
        cell=f"{outcome.lost_stage or 'none'}|{space.site(scene, severities)}" if failed else None,
    )


def _slack(rollout: Rollout) -> float:
    """1 for success at the first step, 1/2 at the second, 1/3 at the third."""
    done = np.flatnonzero(rollout.trace >= 1.0)
    return 1.0 / (1.0 + float(done[0])) if len(done) else 0.0
