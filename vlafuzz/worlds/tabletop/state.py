"""State, a snapshot of the tabletop as arrays, and the tasks and monitors that judge it."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.task import Monitor, Task
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

Array = NDArray[np.float64]
TABLE, HAND, ARM = "table", "hand", "arm"


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """A snapshot. Objects are in the scene's order: targets, then confounders. Metres.

    ``contacts``: pairs (object index, what it touches: another index, ``table``, ``hand`` or ``arm``); pairs of objects
    in both orders. Only of object 0 and of the hand; empty until the gripper first closes.
    """

    positions: Array  # (n, 3) of the objects' origins
    rotations: Array  # (n, 3, 3)
    tcp: Array  # (3,) tool centre point
    tcp_rotation: Array  # (3, 3)
    opening: float  # gap between the fingers
    held: int | None = None  # the object that all fingers press on
    contacts: frozenset[tuple[int, int | str]] = field(default=frozenset())
    earlier: tuple[Array, Array] | None = None  # positions and rotations one control step ago
    seconds: float = 0.2  # of a control step

    def touches(self, index: int) -> set[int | str]:
        return {other for touching, other in self.contacts if touching == index}

    def at_rest(self, index: int) -> bool:
        """Whether an object was slower than 1 cm/s and 0.1 rad/s over the last control step.

        PhysX's velocities are unsuitable: a can that stands still has up to 3 cm/s and 0.5 rad/s.
        """
        if self.earlier is None:
            return True
        positions, rotations = self.earlier
        cosine = (float(np.vdot(self.rotations[index], rotations[index])) - 1) / 2
        turned = math.acos(min(max(cosine, -1.0), 1.0))
        moved = math.dist(self.positions[index].tolist(), positions[index].tolist())
        return moved < 0.01 * self.seconds and turned < 0.1 * self.seconds


def corners(model: ObjectModel, state: State, index: int) -> Array:
    """``(m, 3)`` hull vertices of object ``index`` in the world, metres."""
    return np.asarray(model.vertices @ state.rotations[index].T + state.positions[index])


@dataclass(frozen=True, eq=False)
class Situation:
    """A state with what it is judged against: the objects' models and the state at the start."""

    models: tuple[ObjectModel, ...]
    start: State
    now: State
    _corners: dict[int, Array] = field(default_factory=dict, init=False, repr=False)

    def corners(self, index: int) -> Array:
        """``(m, 3)`` hull vertices of an object now, metres; cached, since several stages use them."""
        if index not in self._corners:
            self._corners[index] = corners(self.models[index], self.now, index)
        return self._corners[index]


@dataclass(frozen=True)
class TableTask(Task):
    """A task whose situations are ``Situation``."""

    onto: str | None = None  # what the second target must be, ``support`` or ``container``

    def solved(self, models: tuple[ObjectModel, ...], state: State) -> bool:
        """Whether the success condition holds in a start state."""
        return self.stages[-1].holds(Situation(models, state, state))


class StateMonitor(Monitor):
    """A monitor of a task on the tabletop, which observes states."""

    def __init__(self, task: TableTask, models: tuple[ObjectModel, ...], start: State) -> None:
        super().__init__(task.stages, task.published)
        self._models, self._start = models, start

    def observe(self, situation: State) -> None:
        """Take notice of the state after a control step."""
        super().observe(Situation(self._models, self._start, situation))
