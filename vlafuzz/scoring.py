"""What an outcome is worth: the score that a strategy is told, the cell of a failure, and intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.rig import Workspace
from vlafuzz.scene import Scene

FAR = 0.5  # severity above which an operator counts as one of a failure's
_GRID = 4  # rows and columns of the workspace


class Measure(Protocol):
    """How far scenes are from nominal."""

    def severity(self, scene: Scene) -> float:
        """Of the whole scene, 0 at nominal."""

    def severities(self, scene: Scene) -> Mapping[str, float]:
        """Of each operator, in [0, 1]."""


@dataclass(frozen=True)
class Score:
    """What a strategy is told of a proposal.

    Attributes:
        progress: of the worst rollout, in [0, 1]; None where the subject was not judged (INVALID, ERROR).
        severity: the scene's distance from nominal.
    """

    verdict: Verdict
    progress: float | None
    severity: float

    @property
    def failed(self) -> bool:
        """Whether the subject failed in a fair scene."""
        return self.verdict is Verdict.FAILED

    @property
    def rolled_out(self) -> bool:
        """Whether the verdict says something about the subject."""
        return self.verdict >= Verdict.PASSED


Objective = Callable[[Scene, Outcome, Measure], Score]


def score(scene: Scene, outcome: Outcome, space: Measure) -> Score:
    """The default objective: verdict, progress and severity."""
    known = outcome.verdict >= Verdict.PASSED and math.isfinite(outcome.progress)
    return Score(outcome.verdict, outcome.progress if known else None, space.severity(scene))


def cell(scene: Scene, outcome: Outcome, severities: Mapping[str, float], workspace: Workspace) -> str:
    """Where a failure lies before triage, readable: ``grasp|camera-position+light|x0y3``.

    The lost stage, the operators far from nominal (``base`` for none), and the first target's place in a
    4 × 4 grid of the workspace. Two failures in one cell may well be one bug.
    """
    operators = sorted(name for name, value in severities.items() if value > FAR)
    target = scene.targets[0]
    column, row = _bin(target.x, workspace.x), _bin(target.y, workspace.y)
    return f"{outcome.lost_stage or 'none'}|{'+'.join(operators) or 'base'}|x{column}y{row}"


def _bin(value: float, bounds: tuple[float, float]) -> int:
    low, high = bounds
    share = (value - low) / (high - low)
    return int(min(max(share * _GRID, 0), _GRID - 1))


class Interval(NamedTuple):
    """Both ends included."""

    low: float
    high: float


def wilson(k: int, n: int, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a share, ``k`` of ``n``; all of [0, 1] when n is 0."""
    if n == 0:
        return Interval(0.0, 1.0)
    from scipy.stats import binomtest  # half a second to import, and needed at the end only

    found = binomtest(k, n).proportion_ci(confidence_level=confidence, method="wilson")
    return Interval(float(found.low), float(found.high))
