"""State: what the simulator knows about a moment, as arrays. Stages and progress are pure functions of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlafuzz.objects.model import ObjectModel

Array = NDArray[np.float64]
TABLE, HAND, ARM = "table", "hand", "arm"


@dataclass(frozen=True, eq=False)
class State:
    """One moment. Objects in the scene's order: targets, then confounders.

    Attributes:
        positions: ``(n, 3)`` of the objects' origins, metres.
        rotations: ``(n, 3, 3)`` matrices.
        linear: ``(n,)`` speed over the last control step, m/s; angular: ``(n,)`` likewise, rad/s. Zero at the
            start. PhysX's own velocities are of no use for this: those of a can that stands still go up to
            3 cm/s and 0.5 rad/s.
        tcp: ``(3,)`` tool centre point, metres; ``tcp_rotation``: ``(3, 3)``.
        opening: between the fingers, metres.
        held: index of the object that both fingers press on, or None.
        contacts: pairs (object index, what it touches: another index, ``table``, ``hand`` or ``arm``); both
            orders of two objects are in it. Only those with object 0 or the hand, and only from the first
            closing of the gripper on; empty before.
    """

    positions: Array
    rotations: Array
    linear: Array
    angular: Array
    tcp: Array
    tcp_rotation: Array
    opening: float
    held: int | None = None
    contacts: frozenset[tuple[int, int | str]] = field(default=frozenset())

    def touches(self, index: int) -> set[int | str]:
        """What object ``index`` touches."""
        return {other for one, other in self.contacts if one == index}

    def at_rest(self, index: int) -> bool:
        """Slower than 1 cm/s and 0.1 rad/s over the last control step."""
        return bool(self.linear[index] < 0.01 and self.angular[index] < 0.1)


def speeds(positions: Array, rotations: Array, before: State, seconds: float) -> tuple[Array, Array]:
    """How fast objects moved and turned, ``(n,)`` m/s and ``(n,)`` rad/s, since an earlier state."""
    pairs = zip(positions.tolist(), before.positions.tolist(), strict=True)
    traces = np.einsum("nij,nij->n", rotations, before.rotations).tolist()
    turned = [math.acos(min(max((trace - 1) / 2, -1.0), 1.0)) for trace in traces]
    return np.array([math.dist(*pair) for pair in pairs]) / seconds, np.array(turned) / seconds


def corners(model: ObjectModel, state: State, index: int) -> Array:
    """``(m, 3)`` hull vertices of object ``index`` in the world, metres."""
    return np.asarray(model.vertices @ state.rotations[index].T + state.positions[index])
