"""What came of a scene: rollouts, and the verdict over them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Verdict(IntEnum):
    """How a scene ended, from the least to the most interesting."""

    ERROR = 0  # policy or simulator broke; says nothing about the scene
    INVALID = 1  # not a fair scene; says nothing about the policy
    PASSED = 2
    FAILED = 3


@dataclass(frozen=True, eq=False)
class Rollout:
    """One episode of a policy in a scene.

    Attributes:
        reached: stages in the order in which they were reached.
        progress: best over the rollout, in [0, 1].
        trace: ``(steps,)`` progress after each control step.
        actions: ``(steps, 7)`` metric actions as executed: dx dy dz (metres), rotation vector (radians),
            gripper in [-1, 1] (1 open).
        published_success: success by the published environments' weaker criteria.
        states_hash: of all body and joint states at every step: equal trajectories have equal hashes.
    """

    success_once: bool
    success_at_end: bool
    published_success: bool
    reached: tuple[str, ...]
    progress: float
    trace: NDArray[np.float32]
    actions: NDArray[np.float32]
    states_hash: str
    seconds: float

    @property
    def steps(self) -> int:
        """Control steps done."""
        return len(self.trace)


@dataclass(frozen=True, eq=False)
class Outcome:
    """All rollouts of one scene with their verdict.

    Attributes:
        progress: of the worst rollout, in [0, 1]; 0 where there is none.
        lost_stage: the first stage that the worst rollout did not reach; None unless FAILED.
        detail: why it is INVALID or ERROR, in a sentence; else empty.
        check: the validity check that rejected it (``semantic``, ``geometry``, ``settling``, ``solved``);
            else empty.
        unanswered: an ERROR for which the policy was not there, or too late, whenever it was asked.
    """

    verdict: Verdict
    rollouts: tuple[Rollout, ...] = field(default=())
    progress: float = 0.0
    lost_stage: str | None = None
    detail: str = ""
    check: str = ""
    unanswered: bool = False

    @staticmethod
    def invalid(check: str, detail: str) -> Outcome:
        """Not a fair scene."""
        return Outcome(Verdict.INVALID, detail=detail, check=check)

    @staticmethod
    def error(detail: str, *, unanswered: bool = False) -> Outcome:
        """Policy or simulator broke."""
        return Outcome(Verdict.ERROR, detail=detail, unanswered=unanswered)

    @staticmethod
    def of(rollouts: tuple[Rollout, ...], stages: tuple[str, ...]) -> Outcome:
        """PASSED when every rollout succeeded once, else FAILED at the worst one's first missing stage."""
        worst = min(rollouts, key=lambda rollout: (rollout.success_once, rollout.progress))
        if worst.success_once:
            return Outcome(Verdict.PASSED, rollouts, worst.progress)
        lost = next(stage for stage in stages if stage not in worst.reached)
        return Outcome(Verdict.FAILED, rollouts, worst.progress, lost)
