"""What an outcome is worth: the score that a strategy is told, and the cell of a failure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vlafuzz.outcome import Outcome, Rollout, Verdict
from vlafuzz.rigs.rig import Workspace
from vlafuzz.rigs.robots import rig
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
        progress: of the worst rollout, in [0, 1]; None where the policy was not judged (INVALID, ERROR).
        severity: the scene's distance from nominal.
        slack: of a pass, how soon its slowest rollout succeeded, in (0, 1]; 0 of everything else.
        cell: where a failure lies, see ``cell``; None for everything else.
    """

    verdict: Verdict
    progress: float | None
    severity: float
    slack: float = 0.0
    cell: str | None = None

    @property
    def failed(self) -> bool:
        """Whether the policy failed in a fair scene."""
        return self.verdict is Verdict.FAILED

    @property
    def rolled_out(self) -> bool:
        """Whether the verdict says something about the policy."""
        return self.verdict >= Verdict.PASSED

    @property
    def ease(self) -> float:
        """How far the scene is from making the policy fail early, in [0, 2]; infinite when not judged.

        Failures come before passes, by how far they came; passes by how late they succeeded: a policy that
        only just succeeds is taken to be near to failing.
        """
        return math.inf if self.progress is None else self.progress + self.slack


Objective = Callable[[Scene, Outcome, Measure], Score]


def score(scene: Scene, outcome: Outcome, space: Measure) -> Score:
    """The default objective: everything that a ``Score`` has."""
    severities = space.severities(scene)
    known = outcome.verdict >= Verdict.PASSED and math.isfinite(outcome.progress)
    passed, failed = outcome.verdict is Verdict.PASSED, outcome.verdict is Verdict.FAILED
    return Score(
        verdict=outcome.verdict,
        progress=outcome.progress if known else None,
        severity=space.severity(scene),
        slack=min(map(_slack, outcome.rollouts), default=0.0) if passed else 0.0,
        cell=cell(scene, outcome, severities, rig(scene.robot).workspace) if failed else None,
    )


def _slack(rollout: Rollout) -> float:
    """1 for success at the first step, a half at the second, a third at the third."""
    done = np.flatnonzero(rollout.trace >= 1.0)
    return 1.0 / (1.0 + float(done[0])) if len(done) else 0.0


def cell(scene: Scene, outcome: Outcome, severities: Mapping[str, float], workspace: Workspace) -> str:
    """Where a failure lies before triage, readable: ``grasp|camera-position+light|x0y3``.

    The lost stage, and the scene's ``site``. Two failures in one cell may well be one bug.
    """
    return f"{outcome.lost_stage or 'none'}|{site(scene, severities, workspace)}"


def site(scene: Scene, severities: Mapping[str, float], workspace: Workspace) -> str:
    """What of a cell is known before a rollout: ``camera-position+light|x0y3``.

    The operators far from nominal (``base`` for none), and the first target's place in a 4 × 4 grid of the
    workspace.
    """
    operators = sorted(name for name, value in severities.items() if value > FAR)
    target = scene.targets[0]
    column, row = _bin(target.x, workspace.x), _bin(target.y, workspace.y)
    return f"{'+'.join(operators) or 'base'}|x{column}y{row}"


def _bin(value: float, bounds: tuple[float, float]) -> int:
    low, high = bounds
    share = (value - low) / (high - low)
    return int(min(max(share * _GRID, 0), _GRID - 1))
