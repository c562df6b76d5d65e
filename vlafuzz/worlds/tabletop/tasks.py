"""The state of the tabletop, and the four tasks of VLATest (FSE 2025, section 4.1) that judge it; instructions.

Success is as described in the paper.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache

import numpy as np
from pydantic import TypeAdapter

from vlafuzz.common.arrays import Array
from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model import Monitor, Stage, Task
from vlafuzz.model.conditions import check_choice
from vlafuzz.worlds.events import UPRIGHT, Looked
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

TABLE, HAND, ARM = "table", "hand", "arm"
A, B = 0, 1  # the first target is manipulated, the second one is where it goes
LIFTED = 0.02  # height above the start, metres
MOVED = 0.03  # displacement, metres
NEAR = 0.05  # gap between two footprints, metres
AWAY = -5.0  # metres from its place to where a thing waits that is put down later: under the floor, seen by nobody
ON_TABLE = 0.004  # gap between an object and the table, due to contact offset and settling, metres
INSIDE = 0.005  # overlap of a hull with a container's wall, as collision parts are slightly rounded, metres
_ANGLES = np.arange(0.0, 2 * np.pi, np.pi / 32)
_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])  # (2, 64)


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

    @property
    def there(self) -> list[int]:
        """The objects that are in the room: all but one that waits to be put down."""
        return [index for index, height in enumerate(self.positions[:, 2].tolist()) if height > AWAY / 2]

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
        super().__init__(task.stages)
        self._models, self._start = models, start

    def observe(self, situation: State) -> None:
        """Take notice of the state after a control step."""
        super().observe(Situation(self._models, self._start, situation))

    def about(self, models: tuple[ObjectModel, ...], start: State) -> None:
        """The first target is another one from now on."""
        self._models, self._start = models, start
        self.begin_anew()


def looked_at(s: Situation) -> Looked:
    """Look at what tells whether the robot stands still."""
    held = np.arange(len(s.models)) == s.now.held
    return Looked(s.now.tcp, s.now.positions[:, 2], s.now.rotations[:, 2], held)


def _toward(remaining: float, whole: float) -> float:
    return min(max(1.0 - remaining / max(whole, 1e-6), 0.0), 1.0)


def _reaching(s: Situation) -> float:
    return _toward(*(math.dist(state.positions[A], state.tcp) for state in (s.now, s.start)))


GRASP = Stage("grasp", lambda s: s.now.held == A, _reaching)


# pick up a


def _height(s: Situation) -> float:
    return float(s.now.positions[A, 2] - s.start.positions[A, 2])


def _lifted(s: Situation) -> bool:
    return s.now.held == A and _height(s) >= LIFTED


# move a near b


def _displacements(s: Situation) -> list[float]:
    pairs = zip(s.now.positions[:, :2].tolist(), s.start.positions[:, :2].tolist(), strict=True)
    return [math.dist(*pair) for pair in pairs]


def _moved(s: Situation) -> bool:
    first, *others = _displacements(s)
    return first > max([MOVED, *others])


@lru_cache(maxsize=4)  # start and present are needed repeatedly
def _gap(models: tuple[ObjectModel, ...], state: State) -> float:
    """Gap between the two targets' footprints in metres; negative if they overlap.

    The distance of two convex sets is their largest separation over all directions; 64 directions are exact to 0.12 %.
    """
    a, b = (corners(models[index], state, index)[:, :2] @ _DIRECTIONS for index in (A, B))
    return float((b.min(axis=0) - a.max(axis=0)).max())


def _on_table(s: Situation, index: int) -> bool:
    return s.now.at_rest(index) and abs(s.corners(index)[:, 2].min()) < ON_TABLE


def _is_near(s: Situation) -> bool:
    if not (_on_table(s, A) and _on_table(s, B)):
        return False
    upright = s.now.rotations[B][2] @ s.start.rotations[B][2]  # the world's z axis in the frame of b
    return bool(upright >= UPRIGHT) and _gap(s.models, s.now) <= NEAR


def _nearing(s: Situation) -> float:
    return _toward(max(_gap(s.models, s.now) - NEAR, 0.0), max(_gap(s.models, s.start) - NEAR, 1e-3))


# put a on b, put a into b


def _bringing(s: Situation) -> float:
    return _toward(*(math.dist(state.positions[A, :2], state.positions[B, :2]) for state in (s.now, s.start)))


def _is_over(s: Situation) -> bool:
    a = s.now.positions[A]
    if a[2] <= s.now.positions[B, 2]:
        return False
    farthest = ((s.corners(B)[:, :2] - a[:2]) @ _DIRECTIONS).max(axis=0)
    return bool(farthest.min() > 0)  # if a is outside, all of b is behind it in some direction


def _lowering(s: Situation) -> float:
    if not _is_over(s):
        return 0.0
    air = s.corners(A)[:, 2].min() - s.now.positions[B, 2]
    return _toward(max(float(air), 0.0), 0.2)


def _released_on(s: Situation) -> bool:
    touched = s.now.touches(A)
    return B in touched and not touched & {TABLE, HAND, ARM} and s.now.at_rest(A)


def _is_inside(s: Situation) -> bool:
    container = s.models[B].container
    if container is None or not _released_on(s):
        return False
    local = (s.corners(A) - s.now.positions[B]) @ s.now.rotations[B]
    half = np.array([container.width, container.depth]) / 2 + INSIDE
    return bool(np.all(np.abs(local[:, :2]) <= half))


LIFT = Stage("lift", _lifted, lambda s: _height(s) / LIFTED if s.now.held == A else 0.0)
MOVE = Stage("move", _moved, lambda s: _displacements(s)[A] / MOVED)
BRING = Stage("move", _is_over, _bringing)
_TASKS = (
    TableTask("pick-up", 1, (GRASP, LIFT, Stage("success", _lifted, lambda s: 0.0, 5))),
    TableTask("move-near", 2, (GRASP, MOVE, Stage("success", _is_near, _nearing))),
    TableTask("put-on", 2, (GRASP, BRING, Stage("success", _released_on, _lowering)), onto="support"),
    TableTask("put-in", 2, (GRASP, BRING, Stage("success", _is_inside, _lowering)), onto="container"),
)
TASKS = {task.name: task for task in _TASKS}


@cache
def task(name: str) -> TableTask:
    """The task of that name; a UsageError if there is none. Before it may stand the world that simulates it."""
    found = TASKS[check_choice("task", kind(name), TASKS)]
    return found if name == found.name else replace(found, name=name)


def kind(name: str) -> str:
    """A task's name without that of the world."""
    return name.rpartition("/")[2]


_WORDINGS = TypeAdapter(dict[str, list[str]])
_SLOTS = ("{a}", "{b}")


@cache
def load_wordings() -> Mapping[str, tuple[str, ...]]:
    """The wordings of every task, each of which names all targets; the nominal one first."""
    path = operators_dir() / "instructions.yaml"
    wordings = validated(_WORDINGS, read_yaml(path, CatalogueError), path, CatalogueError)
    return {name: tuple(wordings[name]) for name in TASKS}


def wordings_of(task: str) -> tuple[str, ...]:
    """Those of one task, whatever world it is of."""
    return load_wordings()[kind(task)]


def say(wording: str, spoken: Sequence[str]) -> str:
    """A wording with the targets' spoken names filled in."""
    for slot, name in zip(_SLOTS, spoken, strict=False):
        wording = wording.replace(slot, name)
    return wording
