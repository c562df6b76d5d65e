"""Outcome: the rollouts of a scene and their verdict."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Verdict(IntEnum):
    """How a scene ended, from the least to the most interesting."""

    ERROR = 0  # the policy or the simulator crashed
    INVALID = 1  # the scene is not fair
    PASSED = 2
    FAILED = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Rollout:
    """One episode of a policy in a scene.

    Attributes:
        reached: stages in the order in which they were reached.
        progress: the best in the rollout, in [0, 1].
        trace: ``(steps,)`` progress after each control step.
        actions: ``(steps, 7)`` metric actions as executed: dx dy dz (metres), rotation vector (radians), gripper in
            [-1, 1] (1 open).
        recovery: control steps from the end of the scene's last event until there was more progress than before it;
            None if no event began, or there was none.
        states_hash: of all body and joint states at every step. Equal trajectories have equal hashes.
    """

    success_once: bool
    success_at_end: bool
    reached: tuple[str, ...]
    progress: float
    trace: NDArray[np.float32]
    actions: NDArray[np.float32]
    states_hash: str
    seconds: float
    recovery: int | None = None

    @property
    def steps(self) -> int:
        return len(self.trace)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """All rollouts of a scene with their verdict.

    Attributes:
        progress: of the worst rollout, in [0, 1]; 0 without rollouts.
        lost_stage: the first stage that the worst rollout did not reach; None unless FAILED. detail: the reason for
        INVALID or ERROR in a sentence; else empty.
        check: the validity check that rejected the scene (``semantic``, ``geometry``, ``settling``, ``solved``); else
            empty.
        unanswered: whether an ERROR is due to a policy that was unreachable or too slow at every attempt.
    """

    verdict: Verdict
    rollouts: tuple[Rollout, ...] = field(default=())
    progress: float = 0.0
    lost_stage: str | None = None
    detail: str = ""
    check: str = ""
    unanswered: bool = False

    @property
    def judged(self) -> bool:
        """Whether it passed or failed."""
        return self.verdict >= Verdict.PASSED

    @property
    def passed(self) -> bool:
        return self.verdict is Verdict.PASSED

    @staticmethod
    def invalid(check: str, detail: str) -> "Outcome":
        return Outcome(verdict=Verdict.INVALID, detail=detail, check=check)

    @staticmethod
    def error(detail: str, *, unanswered: bool = False) -> "Outcome":
        return Outcome(verdict=Verdict.ERROR, detail=detail, unanswered=unanswered)

    @staticmethod
    def of(rollouts: tuple[Rollout, ...], stages: tuple[str, ...]) -> "Outcome":
        """PASSED if every rollout succeeded once, else FAILED at the worst one's first missing stage."""
        worst = min(rollouts, key=lambda rollout: (rollout.success_once, rollout.progress))
        if worst.success_once:
            return Outcome(verdict=Verdict.PASSED, rollouts=rollouts, progress=worst.progress)
        lost = next(stage for stage in stages if stage not in worst.reached)
        return Outcome(verdict=Verdict.FAILED, rollouts=rollouts, progress=worst.progress, lost_stage=lost)


# These checks name what can be wrong with a scene.
FAIRNESS = {
    "semantic": "with an unknown object, rest pose or task",
    "geometry": "with objects off the table, in each other, or too close",
    "unseen": "with a target that cannot be seen in the first picture",
    "settling": "in which something falls, rolls or shifts in the first second",
    "solved": "that are solved before the robot moves",
}


@dataclass(frozen=True)
class Rejection:
    """Why a scene is not fair: the failed check, one of ``FAIRNESS``, and the reason with values."""

    check: str
    reason: str
