"""Task, Stage and Monitor: what the robot is to do, its milestones, and the progress of a rollout.

Stages and progress are pure functions of a State, a snapshot of the simulation as arrays.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.objects.model import ObjectModel

Array = NDArray[np.float64]
TABLE, HAND, ARM = "table", "hand", "arm"


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """A snapshot. Objects are in the scene's order: targets, then confounders.

    Attributes:
        positions: ``(n, 3)`` of the objects' origins, metres.
        rotations: ``(n, 3, 3)`` matrices.
        tcp: ``(3,)`` tool centre point, metres; ``tcp_rotation``: ``(3, 3)``.
        opening: gap between the fingers, metres.
        held: index of the object that all fingers press on, or None.
        contacts: pairs (object index, what it touches: another index, ``table``, ``hand`` or ``arm``); pairs
            of objects in both orders. Only contacts of object 0 and of the hand; empty until the gripper
            first closes.
        earlier: positions and rotations one control step of ``seconds`` ago; None at the start.
    """

    positions: Array
    rotations: Array
    tcp: Array
    tcp_rotation: Array
    opening: float
    held: int | None = None
    contacts: frozenset[tuple[int, int | str]] = field(default=frozenset())
    earlier: tuple[Array, Array] | None = None
    seconds: float = 0.2

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
class Stage:
    """A milestone, reached when ``holds`` has been true for ``steps`` consecutive control steps.

    ``nearness`` measures in [0, 1] how close a situation is to it. What a situation is depends on the world:
    on the tabletop a ``Situation``.
    """

    name: str
    holds: Callable[[Any], bool]
    nearness: Callable[[Any], float]
    steps: int = 2


@dataclass(frozen=True)
class Task:
    """What the robot is to do.

    Attributes:
        targets: number of objects that the instruction names.
        stages: in order; the last one is success, which implies the others.
        published: the weaker success of the published environments, judged at a single step.
        onto: what the second target must be (``support``, ``container``), if anything.
    """

    name: str
    targets: int
    stages: tuple[Stage, ...]
    published: Callable[[Situation], bool]
    onto: str | None = None

    @property
    def stage_names(self) -> tuple[str, ...]:
        return tuple(stage.name for stage in self.stages)

    def solved(self, models: tuple[ObjectModel, ...], state: State) -> bool:
        """Whether the success condition holds in a start state."""
        return self.stages[-1].holds(Situation(models, state, state))


class Monitor:
    """Tracks stages and progress of a rollout.

    Args:
        stages: in order; the last one is success.
        published: the weaker success, see ``Task.published``.
    """

    def __init__(self, stages: tuple[Stage, ...], published: Callable[[Any], bool]) -> None:
        self._stages, self._published = stages, published
        self._streaks = [0] * len(stages)
        self.reached: list[str] = []
        self.published_success = self.published_now = False
        self._trace: list[float] = []

    def observe(self, situation: Any) -> None:
        """Take notice of the situation after a control step."""
        for index, stage in enumerate(self._stages):
            self._streaks[index] = self._streaks[index] + 1 if stage.holds(situation) else 0
        self._advance()
        self._trace.append(self._progress(situation))
        self.published_now = self._published(situation)
        self.published_success = self.published_success or self.published_now

    @property
    def success_now(self) -> bool:
        """Whether success holds at the last step, and has for long enough."""
        return self._streaks[-1] >= self._stages[-1].steps

    @property
    def success_once(self) -> bool:
        """Whether success has been reached at any step."""
        return len(self.reached) == len(self._stages)

    @property
    def progress(self) -> float:
        """The best progress so far, in [0, 1]."""
        return max(self._trace, default=0.0)

    @property
    def trace(self) -> NDArray[np.float32]:
        """``(steps,)`` progress after each step."""
        return np.array(self._trace, dtype=np.float32)

    def _advance(self) -> None:
        stages = self._stages
        if self.success_now:
            self.reached = [stage.name for stage in stages]
        while len(self.reached) < len(stages) - 1:
            index = len(self.reached)
            if self._streaks[index] < stages[index].steps:
                break
            self.reached.append(stages[index].name)

    def _progress(self, situation: Any) -> float:
        stages, done = self._stages, len(self.reached)
        if done == len(stages):
            return 1.0
        streak = self._streaks[done] / stages[done].steps
        return (done + min(max(stages[done].nearness(situation), streak, 0.0), 0.99)) / len(stages)


class StateMonitor(Monitor):
    """A monitor of a task on the tabletop, which observes states."""

    def __init__(self, task: Task, models: tuple[ObjectModel, ...], start: State) -> None:
        super().__init__(task.stages, task.published)
        self._models, self._start = models, start

    def observe(self, situation: State) -> None:
        """Take notice of the state after a control step."""
        super().observe(Situation(self._models, self._start, situation))
