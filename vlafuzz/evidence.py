"""What triage finds out about a failure, as values: its causes, and a witness that it need not be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BASE = "base"  # in a signature: even the nominal scene fails

Actions = NDArray[np.float32]


@dataclass(frozen=True)
class Threshold:
    """From where on an operator makes the subject fail, all else as in the minimal scene.

    Attributes:
        gene: where the value stands in a scene, if it is one value; else several move together.
        value: the one nearest to nominal that fails; None for several.
        share: of the way from nominal to the minimal scene, in (0, 1].
    """

    operator: str
    gene: str | None
    value: float | None
    share: float

    def __str__(self) -> str:
        if self.gene is None or self.value is None:
            return f"{self.operator}: fails from {self.share:.0%} of the way on"
        slot, _, name = self.gene.rpartition(".")
        of = f" of object {int(slot[-1]) + 1}" if slot.startswith("targets.") and slot[-1] != "0" else ""
        return f"{self.operator}: fails from {name}{of} {_with_unit(name, self.value)} on"


@dataclass(frozen=True)
class Causes:
    """Of a failure, as its minimal scene shows them.

    Attributes:
        necessary: without one of them the subject passes.
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
        grasp: which of its grasps the expert began with, from 0.
    """

    actions: Actions
    states_hash: str
    grasp: int


def signature(task: str, lost: str, operators: Iterable[str]) -> str:
    """Which bug it is, readable: ``pick-up|grasp|camera-orientation+light``."""
    return f"{task}|{lost}|{'+'.join(sorted(operators)) or BASE}"


def _with_unit(name: str, value: float) -> str:
    if name == "intensity":
        return f"× {value:g}"
    return f"{value:g} m" if name in ("x", "y", "distance") else f"{value:g}°"
