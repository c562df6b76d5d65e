"""What triage finds out about a failure, as values: its causes, and a witness that it need not be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scene import in_words

BASE = "base"  # in a signature: even the nominal scene fails

Actions = NDArray[np.float32]


@dataclass(frozen=True)
class Threshold:
    """From where on an operator makes the policy fail, all else as in the minimal scene.

    Attributes:
        at: the values nearest to nominal that fail, each with where it stands in a scene; several moved
            together.
        share: of the way from nominal to the minimal scene, in (0, 1].
    """

    operator: str
    at: tuple[tuple[str, float], ...]
    share: float

    def __str__(self) -> str:
        values = ", ".join(in_words(path, value) for path, value in self.at)
        way = "" if len(self.at) == 1 else f" ({self.share:.0%} of the way)"
        return f"{self.operator}: fails from {values}{way} on"


@dataclass(frozen=True)
class Causes:
    """Of a failure, as its minimal scene shows them.

    Attributes:
        necessary: without one of them the policy passes.
        sufficient: put alone onto the nominal scene, they make it fail.
    """

    necessary: tuple[str, ...] = ()
    sufficient: tuple[str, ...] = ()
    thresholds: tuple[Threshold, ...] = ()


@dataclass(frozen=True, eq=False)
class Witness:
    """A solution of a scene.

    Attributes:
        actions: ``(steps, 7)`` metric, as ``Rollout.actions``, relative to where the hand is.
        states_hash: of the trajectory that they made when played again.
        attempt: of the expert, from 0: which grasp it began with, and from which direction.
    """

    actions: Actions
    states_hash: str
    attempt: int


def signature(task: str, lost: str, operators: Iterable[str]) -> str:
    """Which bug it is, readable: ``pick-up|grasp|camera-orientation+light``."""
    return f"{task}|{lost}|{'+'.join(sorted(operators)) or BASE}"
