"""The scenes of LIBERO: the suites' own initial states, and what the operators make of them."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model import Gene, Grid, Placement, Scene
from vlafuzz.model.scene import Start
from vlafuzz.model.space import Values
from vlafuzz.worlds.libero.casts import doubles, extras, load_objects, recast, swaps, switches
from vlafuzz.worlds.libero.room import room_of
from vlafuzz.worlds.libero.stages import task as task_named
from vlafuzz.worlds.libero.suites import REST, LiberoTask, find_task, find_tasks
from vlafuzz.worlds.manipulation import extras as others, operators as kinds
from vlafuzz.worlds.manipulation.base import Layout, Operator
from vlafuzz.worlds.manipulation.composer import TableComposer, index_of
from vlafuzz.worlds.manipulation.operator_set import OperatorSet
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.manipulation.space import HINT, REDRAWS, RESTARTS, TableSpace

# How an instruction is said: the suite's own way, then frames around it; last comes LIBERO-PRO's paraphrase.
WORDINGS = (
    "{instruction}",
    "please {instruction}",
    "could you {instruction}",
    "I need you to {instruction}",
    "now {instruction}, and be careful",
    "your next job is to {instruction}",
)
# What keys of LIBERO's runs hold for objects: the digest of a catalogue that they never read.
OBJECTS = "60b651b6641f1773"
RIDING = 0.2  # of the range for a thing that stands on another one: farther, and it would fall off
# These operators move the suite's own things; others have the genes of the tabletop.
LACKING = ("backdrop", "target-topple")  # which the tabletop alone has; in mid-episode, target-knock is ours
_MOVING = (kinds.TargetPosition, kinds.TargetOrientation, others.BystanderPosition, others.BystanderOrientation)
_OWN = [kind.name for kind in _MOVING]
_SHARED = [name for name in kinds.OPERATORS if name not in _OWN and name not in others.EXTRAS] + sorted(
    others.EXTRAS - {*LACKING, *_OWN}
)


def nominal_scene(task: str, robot: str, state: int = 0) -> Scene:
    """One of the suite's own initial states, by default 0, with nothing changed."""
    found = find_task(task)
    things = tuple(Placement(name, REST, 0.0, 0.0) for name in found.things)
    return Scene(task, things, found.instruction, robot=robot, start=Start(state))


class LiberoComposer(TableComposer):
    """Composes scenes of one task. The targets' places are offsets from an initial state: nominal is zero."""

    def __init__(self, operators: OperatorSet, task: LiberoTask, robot: str) -> None:
        self._libero = task
        slots = _slots(operators, task)
        nominal = {slot: int(slot[-1]) if slot.startswith("confounders") else 0 for slot in slots}
        layout = Layout(slots, nominal, 1, len(_said(task)), rig(robot))
        placing = [gene for kind in _OWN for gene in self._placing(operators.operators[kind])]
        alone = {"goal-slide"} if task.concerned < 2 else set[str]()  # what it is brought to cannot be moved
        alone |= set() if switches(task) else {"target-switch"}
        shared = [gene for name in _SHARED if name not in alone for gene in operators.operators[name].genes(layout)]
        genes = (gene for gene in (*placing, *shared) if gene.kind != "category" or gene.grid.size > 1)
        super().__init__(str(task), robot, layout, genes)

    def _placing(self, operator: Operator) -> Iterator[Gene]:
        concerned, name = self._libero.concerned, operator.name
        bystanders = isinstance(operator, (others.BystanderPosition, others.BystanderOrientation))
        slots = range(concerned, len(self._libero.things)) if bystanders else range(concerned)
        for slot in slots:
            share = RIDING if self._libero.things[slot] in self._libero.riders else 1.0
            if isinstance(operator, (kinds.TargetPosition, others.BystanderPosition)):
                for axis, span in (("x", operator.x), ("y", operator.y)):
                    grid = Grid(share * span.low, share * span.high, span.step, 0.0)
                    yield Gene(name, f"targets.{slot}.{axis}", "real", grid)
            elif isinstance(operator, (kinds.TargetOrientation, others.BystanderOrientation)):
                yield Gene(name, f"targets.{slot}.yaw", "real", operator.yaw.grid(0.0))

    def is_free(self, slot: str, name: str, taken: Sequence[str]) -> bool:
        things = len(self._libero.things)
        own = len(taken) < things or not doubles(recast(self._libero, tuple(taken[:things])), name)
        return own and name not in taken

    def placement(self, values: Mapping[str, float], slot: str, name: str) -> Placement:
        return Placement(name, REST, *(values.get(f"{slot}.{part}", 0.0) for part in ("x", "y", "yaw")))

    def wordings(self, targets: Sequence[str]) -> Sequence[str]:
        try:
            return _said(recast(self._libero, tuple(targets)))
        except SceneError:  # other things, which stand for no index either
            return ()

    def placed(self, slot: str, placement: Placement) -> Values:
        known = placement.object in self.layout.slots[slot] and placement.quaternion is None
        return {f"{slot}.object": index_of(self.layout.slots[slot], placement.object)} | {
            f"{slot}.{part}": getattr(placement, part) if known else math.nan for part in ("x", "y", "yaw")
        }


def _slots(operators: OperatorSet, task: LiberoTask) -> dict[str, tuple[str, ...]]:
    """The slots of scenes and the things allowed there; a UsageError for names that are swapped or added nowhere."""
    types, around = operators.get(kinds.TargetType).names, operators.get(kinds.ConfounderType).names
    _check_names(kinds.TargetType.name, types, load_objects().words)
    _check_names(kinds.ConfounderType.name, around, load_objects().added)
    targets = [(names[0], *(name for name in names[1:] if types is None or name in types)) for names in swaps(task)]
    added = tuple(name for name in extras(task) if around is None or name in around)
    slots = {f"targets.{number}": names for number, names in enumerate(targets)}
    count = min(operators.get(kinds.ConfounderCount).high, len(added))
    return slots | {f"confounders.{number}": added for number in range(count)}


def _check_names(operator: str, names: Iterable[str] | None, known: Collection[str]) -> None:
    for name in names or ():
        if name not in known:
            raise UsageError(f"{operator}: names: no {name!r} in LIBERO", hint=f"known: {', '.join(known)}")


@cache
def _said(task: LiberoTask) -> tuple[str, ...]:
    said = (wording.replace("{instruction}", task.instruction) for wording in WORDINGS)
    return (*said, task.paraphrase) if task.paraphrase else tuple(said)


class LiberoSpace(TableSpace):
    """Every scene that the operators can make of a task's initial states."""

    def __init__(self, operators: OperatorSet, task: str, robot: str) -> None:
        self.composer = LiberoComposer(operators.in_task(task), find_task(task), robot)
        super().__init__(task_named(task), rig(robot), operators.in_task(task), self.composer)

    @property
    def conditions(self) -> dict[str, Any]:
        return super().conditions | {"catalogue_digest": OBJECTS, "packs": "[]"}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.operators, self.task.name, self.robot)

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene with room for everything; a UsageError if the ranges leave none.

        What else is fair is judged by physics, before a rollout.
        """
        for _ in range(RESTARTS):
            drawn = self.composer.compose({path: self.draw(path, rng) for path in self.by_path})
            if (scene := self.repaired(drawn, rng)) is not None:
                return scene
        raise UsageError(f"{self.task.name}: no scene in these ranges has room for everything", hint=HINT)

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene, with things moved that are too close to others or out of reach; None without room."""
        room, slots = room_of(self.task.name), self.composer.layout.used(len(scene.confounders))
        for _ in range(REDRAWS):
            if not (misplaced := room.crowded(scene) | room.out_of_reach(scene).keys()):
                return scene
            slot = slots[rng.choice(sorted(misplaced))]
            again = {path: self.draw(path, rng) for path in (f"{slot}.x", f"{slot}.y")}
            scene = self.composer.compose(self.values(scene) | again)
        return None

    def misnamed(self, scene: Scene) -> str | None:
        """The instruction of another task of the suite, if possible about something that is here."""
        task = find_task(self.task.name)
        others = [other for other in find_tasks(task.suite) if other.instruction != task.instruction]
        here = [other for other in others if other.carried and set(other.carried) < set(task.things)]
        return next((other.instruction for other in here + others), None)
