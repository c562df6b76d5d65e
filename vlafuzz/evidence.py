"""The evidence that triage collects about a failure, as values and in words: causes and a witness."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scene import in_words

Actions = NDArray[np.float32]
BASE = "base"  # in a signature: even the nominal scene fails


@dataclass(frozen=True)
class Threshold:
    """The deviation from nominal at which an operator starts to make the policy fail in the minimal scene.

    Attributes:
        at: the failing values nearest to nominal, by their paths in the scene. Several of them move together.
        share: position between nominal and the minimal scene, in (0, 1].
    """

    operator: str
    at: tuple[tuple[str, float], ...]
    share: float


@dataclass(frozen=True)
class Causes:
    """The operators behind a failure, as found in its minimal scene.

    Attributes:
        necessary: the policy passes if any one of them is reset to nominal.
        sufficient: the policy fails if one of them alone is applied to the nominal scene.
    """

    necessary: tuple[str, ...] = ()
    sufficient: tuple[str, ...] = ()
    thresholds: tuple[Threshold, ...] = ()


@dataclass(frozen=True, eq=False)
class Witness:
    """A solution of a scene.

    Attributes:
        actions: ``(steps, 7)`` metric, as ``Rollout.actions``, relative to the hand's present pose.
        states_hash: of the trajectory when the actions were replayed.
        attempt: number of the expert's attempt, which selects its first grasp and direction of approach.
    """

    actions: Actions
    states_hash: str
    attempt: int


def signature(task: str, lost: str, operators: Iterable[str]) -> str:
    """Identifies a cause, readably: ``pick-up|grasp|camera-orientation+light``."""
    return f"{task}|{lost}|{'+'.join(sorted(operators)) or BASE}"


def describe(threshold: Threshold) -> str:
    """The operator and its failing range: ``light: fails from intensity × 6.25 on``."""
    return f"{threshold.operator}: {failing_range(threshold)}"


def failing_range(threshold: Threshold) -> str:
    """The values from which on the policy fails."""
    values = ", ".join(in_words(path, value) for path, value in threshold.at)
    share = "" if len(threshold.at) == 1 else f" ({threshold.share:.0%} of the way)"
    return f"fails from {values}{share} on"
