"""Composer: values, one per gene, to scenes and back. It knows no grid: any number is a value."""

import math
from collections.abc import Mapping, Sequence

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.model.space import Values
from vlafuzz.worlds.manipulation.base import Layout
from vlafuzz.worlds.manipulation.operator_set import OperatorSet
from vlafuzz.worlds.manipulation.operators import (
    OPERATORS,
    ConfounderCount,
    ConfounderOrientation,
    ConfounderType,
    TargetOrientation,
    TargetType,
)
from vlafuzz.worlds.manipulation.parts import Parts, index_of
from vlafuzz.worlds.manipulation.rigs.rig import Hand
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.instructions import load_wordings, say
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.state import TableTask


class Composer:
    """Composes the scenes of one task, from the ``genes`` of all operators, in their order."""

    def __init__(self, operators: OperatorSet, catalogue: Catalogue, task: TableTask, robot: str) -> None:
        self._catalogue, self._task, self._robot = catalogue, task, robot
        self._wordings = load_wordings()[task.name]
        self._fixed = {
            "targets": operators.get(TargetOrientation).fixed,
            "confounders": operators.get(ConfounderOrientation).fixed,
        }
        setup = rig(robot)
        slots = _slots(operators, catalogue, task, setup.hand)
        stable_poses = max(len(catalogue[name].stable_poses) for name in catalogue.names())
        self.layout = Layout(slots, _distinct(slots), stable_poses, len(self._wordings), setup)
        self.genes = [gene for name in OPERATORS for gene in operators.operators[name].genes(self.layout)]
        self._parts = Parts(self.genes)

    def compose(self, values: Mapping[str, float]) -> Scene:
        """The scene with these values. A name that is taken is replaced by the next free one."""
        slots = self.layout.used(int(values["confounders"]))
        names: list[str] = []
        for slot in slots:
            names.append(self._free_name(slot, int(values[f"{slot}.object"]), names))
        placed = tuple(self.placement(values, slot, name) for slot, name in zip(slots, names, strict=True))
        targets = placed[: self._task.targets]
        spoken = [self._catalogue[target.object].spoken for target in targets]
        return Scene(
            task=self._task.name,
            targets=targets,
            instruction=say(self._wordings[int(values["instruction"])], spoken),
            confounders=placed[self._task.targets :],
            robot=self._robot,
            **self._parts.composed(values),
        )

    def placement(self, values: Mapping[str, float], slot: str, name: str) -> Placement:
        """The placement of an object in a slot."""
        poses = self._catalogue[name].stable_poses
        rest = poses[int(values[f"{slot}.rest"]) % len(poses)].name
        yaw = 0.0 if rest in self._fixed[slot.partition(".")[0]] else values[f"{slot}.yaw"]
        return Placement(name, rest, values[f"{slot}.x"], values[f"{slot}.y"], yaw)

    def values(self, scene: Scene) -> Values:
        """The values of everything that a scene has; NaN where no index stands for it."""
        values = self._parts.values(scene) | {"confounders": len(scene.confounders)}
        for part, placements in (("targets", scene.targets), ("confounders", scene.confounders)):
            for slot, placement in zip(self.layout.of(part), placements, strict=False):
                values |= self._placed(slot, placement)
        known = [target.object for target in scene.targets if target.object in self._catalogue]
        spoken = [self._catalogue[name].spoken for name in known]
        wordings = [say(wording, spoken) for wording in self._wordings]
        return values | {"instruction": math.nan if scene.then else index_of(wordings, scene.instruction)}

    def _placed(self, slot: str, placement: Placement) -> Values:
        known = placement.object in self._catalogue and placement.quaternion is None
        poses = [pose.name for pose in self._catalogue[placement.object].stable_poses] if known else []
        return {
            f"{slot}.object": index_of(self.layout.slots[slot], placement.object),
            f"{slot}.rest": index_of(poses, placement.rest),
            f"{slot}.x": placement.x,
            f"{slot}.y": placement.y,
            f"{slot}.yaw": placement.yaw if placement.quaternion is None else math.nan,
        }

    def _free_name(self, slot: str, index: int, taken: Sequence[str]) -> str:
        names = self.layout.slots[slot]
        spoken = {self._catalogue[name].spoken for name in taken}
        free = (name for name in names[index:] + names[:index] if self._catalogue[name].spoken not in spoken)
        return next(free, names[index])


def _slots(
    operators: OperatorSet, catalogue: Catalogue, task: TableTask, hand: Hand
) -> dict[str, tuple[str, ...]]:
    """The slots of a task's scenes, with the names allowed in each."""
    types, around = operators.get(TargetType), operators.get(ConfounderType)
    takes = tuple(name for name in catalogue.graspable() if _fits(catalogue[name], hand))
    slots = {"targets.0": _narrowed("target-type: names", takes, types.names, catalogue)}
    if task.targets > 1:
        slots["targets.1"] = _narrowed("target-type: onto", _offering(task, catalogue), types.onto, catalogue)
    names = _narrowed("confounder-type: names", catalogue.movable(), around.names, catalogue)
    return slots | {f"confounders.{slot}": names for slot in range(operators.get(ConfounderCount).high)}


def _fits(model: ObjectModel, hand: Hand) -> bool:
    """Whether a hand can hold an object in its first graspable stable pose."""
    first = next((pose.grasps for pose in model.stable_poses if pose.grasps), ())
    return any(hand.takes(grasp.width, grasp.z) for grasp in first)


def _offering(task: TableTask, catalogue: Catalogue) -> tuple[str, ...]:
    """The objects that a task can bring another one to."""
    if task.onto is None:
        return catalogue.graspable()
    models = [catalogue[name] for name in catalogue.names()]
    if task.onto == "container":
        return tuple(model.name for model in models if model.container and model.role != "marker")
    return tuple(model.name for model in models if model.supports)


def _narrowed(
    key: str, allowed: tuple[str, ...], names: tuple[str, ...] | None, catalogue: Catalogue
) -> tuple[str, ...]:
    for name in names or ():
        if name not in allowed:
            reason = "is of no use there" if name in catalogue else "is not in the catalogue"
            raise UsageError(f"{key}: {name!r} {reason}", hint="known: " + ", ".join(allowed))
    if not allowed:
        raise UsageError(f"{key}: the catalogue has no object for it", hint="see `vlafuzz list objects`")
    return names or catalogue.preferred(allowed)


def _distinct(slots: Mapping[str, tuple[str, ...]]) -> dict[str, int]:
    """For each slot, the first name that no earlier slot has."""
    nominal: dict[str, int] = {}
    taken: set[str] = set()
    for slot, names in slots.items():
        nominal[slot] = next((index for index, name in enumerate(names) if name not in taken), 0)
        taken.add(names[nominal[slot]])
    return nominal
