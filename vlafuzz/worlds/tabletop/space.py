"""The scenes of a task as a space: values to scenes and back, and random generation by VLATest's Algorithm 1.

Random scenes meet every precondition that the paper states. Objects are drawn without replacement by their spoken
names. Draws that the task does not allow (``semantic_valid``) or that have no room (``safe_dist``) are rejected.
Rejection is bounded: first a position is redrawn, then the whole scene, then generation fails.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.common.text import ambiguous
from vlafuzz.errors import UsageError
from vlafuzz.model import Placement, Scene
from vlafuzz.model.quantities import Quantity
from vlafuzz.model.scene import UNITS
from vlafuzz.model.space import Values
from vlafuzz.worlds.manipulation import operators as kinds
from vlafuzz.worlds.manipulation.base import Layout
from vlafuzz.worlds.manipulation.composer import TableComposer, camera, index_of
from vlafuzz.worlds.manipulation.operator_set import OperatorSet as OperatorSet, load_operators as load_operators
from vlafuzz.worlds.manipulation.rigs import Hand, rig
from vlafuzz.worlds.manipulation.space import HINT, REDRAWS, RESTARTS, TableSpace
from vlafuzz.worlds.tabletop.fairness import checks
from vlafuzz.worlds.tabletop.fairness.footprint import Footprint, footprint
from vlafuzz.worlds.tabletop.fairness.visible import Picture, unseen
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, packs_json
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.quantities import measured, places, quantities_of
from vlafuzz.worlds.tabletop.tasks import TableTask, kind, say, task as task_named, wordings_of


class Composer(TableComposer):
    """Composes the scenes of one task, from the genes of all operators, in their order."""

    def __init__(self, operators: OperatorSet, catalogue: Catalogue, task: TableTask, robot: str) -> None:
        self._catalogue = catalogue
        turning = (kinds.TargetOrientation, kinds.ConfounderOrientation)
        self._fixed = {kind.part: operators.get(kind).fixed for kind in turning}
        setup = rig(robot)
        slots = _slots(operators, catalogue, task, setup.hand)
        stable_poses = max(len(catalogue[name].stable_poses) for name in catalogue.names())
        layout = Layout(slots, _distinct(slots), stable_poses, len(wordings_of(task.name)), setup)
        genes = (gene for name in kinds.OPERATORS for gene in operators.operators[name].genes(layout))
        super().__init__(task.name, robot, layout, genes)

    def is_free(self, slot: str, name: str, taken: Sequence[str]) -> bool:
        return self._catalogue[name].spoken not in {self._catalogue[other].spoken for other in taken}

    def placement(self, values: Mapping[str, float], slot: str, name: str) -> Placement:
        poses = self._catalogue[name].stable_poses
        rest = poses[int(values[f"{slot}.rest"]) % len(poses)].name
        yaw = 0.0 if rest in self._fixed[slot.partition(".")[0]] else values[f"{slot}.yaw"]
        return Placement(name, rest, values[f"{slot}.x"], values[f"{slot}.y"], yaw)

    def wordings(self, targets: Sequence[str]) -> Sequence[str]:
        spoken = tuple(self._catalogue[name].spoken for name in targets if name in self._catalogue)
        return _said(self._task_name, spoken)

    def placed(self, slot: str, placement: Placement) -> Values:
        known = placement.object in self._catalogue and placement.quaternion is None
        poses = [pose.name for pose in self._catalogue[placement.object].stable_poses] if known else []
        return {
            f"{slot}.object": index_of(self.layout.slots[slot], placement.object),
            f"{slot}.rest": index_of(poses, placement.rest),
            f"{slot}.x": placement.x,
            f"{slot}.y": placement.y,
            f"{slot}.yaw": placement.yaw if placement.quaternion is None else math.nan,
        }


@cache
def _said(task: str, spoken: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(say(wording, spoken) for wording in wordings_of(task))


def _slots(operators: OperatorSet, catalogue: Catalogue, task: TableTask, hand: Hand) -> dict[str, tuple[str, ...]]:
    types, around = operators.get(kinds.TargetType), operators.get(kinds.ConfounderType)
    takes = tuple(name for name in catalogue.names("graspable") if _takes(hand, catalogue[name]))
    slots = {"targets.0": _narrowed("target-type: names", takes, types.names, catalogue)}
    if task.targets > 1:
        slots["targets.1"] = _narrowed("target-type: onto", _offering(task, catalogue), types.onto, catalogue)
    names = _narrowed("confounder-type: names", catalogue.names("graspable", "obstacle"), around.names, catalogue)
    return slots | {f"confounders.{slot}": names for slot in range(operators.get(kinds.ConfounderCount).high)}


def _takes(hand: Hand, model: ObjectModel) -> bool:
    """Whether a hand can hold an object in its first graspable stable pose."""
    first = next((pose.grasps for pose in model.stable_poses if pose.grasps), ())
    return any(hand.takes(grasp.width, grasp.z) for grasp in first)


def _offering(task: TableTask, catalogue: Catalogue) -> tuple[str, ...]:
    if task.onto is None:
        return catalogue.names("graspable")
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


_NEAREST = ("confounder-position", "distance of the nearest confounder from the target")
UNITS[_NEAREST[1]] = " m"


class SearchSpace(TableSpace):
    """Every scene that the operators can make of a task, with random generation and repair."""

    def __init__(self, operators: OperatorSet, catalogue: Catalogue, task: str, robot: str = "panda") -> None:
        found, of_task = task_named(task), operators.in_task(kind(task))
        self.composer = Composer(of_task, catalogue, found, robot)
        super().__init__(found, rig(robot), of_task, self.composer)
        self.catalogue, self.onto = catalogue, found.onto

    @property
    def conditions(self) -> dict[str, Any]:
        found = {"catalogue_digest": self.catalogue.digest, "packs": packs_json(self.catalogue.packs)}
        return super().conditions | found

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.operators, self.catalogue, self.task.name, self.rig.robot)

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene that passes the checks before settling; UsageError if the ranges leave no room."""
        # Drawn outside the restarts, so that crowded scenes are not rarer than others.
        count = self.draw("confounders", rng)
        attempt = Attempt(self, rng)
        for _ in range(RESTARTS):
            values = attempt.values(count)
            if values is None:
                continue
            scene = self.composer.compose(values)
            if not (problem := self._unfair(scene)):
                return scene
            attempt.reason = problem
        box = self.operators.get(kinds.TargetPosition).ranges()
        objects = f"{self.task.targets} target(s) and {int(count)} confounder(s)"
        raise UsageError(
            f"{self.task.name}: no scene of {objects}, {self.operators.min_distance:g} m apart, in {box}; "
            f"the last of {RESTARTS} attempts: {attempt.reason}",
            hint=HINT,
        )

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene with as little redrawn as it takes to pass these checks; None when there is no room.

        Objects are placed in order, targets first, so that confounders give way to targets. A scene whose targets
        cannot be seen is not repaired: None. Values beyond their ranges become those at the ends.

        Raises:
            SceneError: it has a value that no operator gives.
        """
        given, attempt = self._expressible(scene, self.by_path), Attempt(self, rng)
        values = given | {path: gene.grid.clipped(given[path]) for path, gene in self.by_path.items()}
        slots = self.composer.layout.used(int(values["confounders"]))
        kept = all(attempt.keep(slot, values) for slot in slots)
        moved = self.composer.compose(values) if kept else None
        return None if moved is None or self._unfair(moved) else moved

    def misnamed(self, scene: Scene) -> str | None:
        """The instruction with a confounder's name instead of the first target's; None without one."""
        if not scene.confounders:
            return None
        objects = (scene.confounders[0], *scene.targets[1:])
        names = [self.catalogue[placed.object].spoken for placed in objects]
        return say(wordings_of(scene.task)[0], names)

    def _unfair(self, scene: Scene) -> str | None:
        """Why the targets cannot be seen, or what its events do is not fair."""
        visible, distance = self.operators.visible, self.operators.min_distance
        problem = unseen(scene, self.catalogue, visible) if visible else None
        late = None if problem else checks.check_events(scene, self.catalogue, distance, visible)
        return late.reason if late else problem

    @cached_property
    def quantities(self) -> Mapping[str, Quantity]:
        return quantities_of(self.task.targets)

    def measured(self, scene: Scene) -> Mapping[str, float]:
        return measured(scene, self.catalogue, self._usual)

    @cached_property
    def _usual(self) -> Array:
        return places(Picture(self.nominal(), self.catalogue), self.task.targets)

    def derived(self, scene: Scene) -> Mapping[tuple[str, str], float]:
        target, *_ = scene.targets
        places = [(other.x - target.x, other.y - target.y) for other in scene.confounders]
        nearest = {_NEAREST: min(round(float(np.hypot(*place)), 3) for place in places)} if places else {}
        return {**super().derived(scene), **nearest}


class Attempt:
    """Repeated attempts at a scene; ``reason`` says why the last one failed."""

    def __init__(self, space: SearchSpace, rng: np.random.Generator) -> None:
        self._space, self._rng = space, rng
        self._placed: list[tuple[Placement, ObjectModel, Footprint]] = []
        self.reason = ""

    def values(self, count: float) -> Values | None:
        """The values of a scene with ``count`` confounders; None if the draws leave no room."""
        space = self._space
        layout, values = space.composer.layout, space.nominal_values | {"confounders": count}
        for path, gene in space.by_path.items():
            if gene.slot not in layout.slots and path != "confounders":
                values[path] = space.draw(path, self._rng)
        self._placed = []
        for slot in layout.used(int(count)):
            name = self._choose(slot, values)
            if name is None or not self._stand(slot, name, values):
                return None
        return values

    def keep(self, slot: str, values: Values) -> bool:
        """Place a slot's object as it is, or with as little redrawn as necessary; return whether it worked.

        An object that the task does not allow beside those placed before gets another rest pose, else another type. One
        without room is moved, each time a little farther from where it was.
        """
        name = self._choose(slot, values, values.copy())
        if name is None:
            return False
        return self._accepts(slot, name, values) or self._stand(slot, name, values, near=values.copy())

    def _choose(self, slot: str, values: Values, first: Values | None = None) -> str | None:
        """Draw a name and a rest pose allowed beside the objects already placed, after trying ``first``."""
        names = self._space.composer.layout.slots[slot]
        for index in self._options(f"{slot}.object", len(names), first):
            model = self._space.catalogue[names[index]]
            if any(ambiguous(model.spoken, other.spoken) for _, other, _ in self._placed):
                continue
            for rest in self._options(f"{slot}.rest", len(model.stable_poses), first):
                values |= {f"{slot}.object": index, f"{slot}.rest": rest}
                if not self._senseless(slot, self._space.composer.placement(values, slot, model.name), model):
                    return model.name
        self.reason = f"no object is left for {slot}"
        return None

    def _options(self, path: str, size: int, first: Values | None) -> Iterator[int]:
        gene = self._space.by_path[path]
        if not self._space.varies(gene):
            yield int(gene.grid.nominal)
            return
        if first is not None:
            yield int(first[path]) % size
        elif gene.drawn < 1 and self._rng.random() >= gene.drawn:
            yield int(gene.grid.nominal)
        yield from self._rng.permutation(size).tolist()

    def _senseless(self, slot: str, placement: Placement, model: ObjectModel) -> str | None:
        if slot == "targets.0":
            return checks.cannot_grasp(placement, model, self._space.rig.hand)
        onto = self._space.onto
        if slot == "targets.1" and onto:
            return checks.cannot_place(onto, *self._placed[0][:2], placement, model)
        return None

    def _stand(self, slot: str, name: str, values: Values, near: Values | None = None) -> bool:
        """Draw positions for an object until there is room; farther and farther from ``near``, if given."""
        for attempt in range(1, REDRAWS + 1):
            for field in ("x", "y"):
                path = f"{slot}.{field}"
                if near is None:
                    values[path] = self._space.draw(path, self._rng)
                else:
                    values[path] = self._moved(path, near[path], attempt / REDRAWS)
            if near is None:
                values[f"{slot}.yaw"] = self._space.draw(f"{slot}.yaw", self._rng)
            if self._accepts(slot, name, values):
                return True
        return False

    def _moved(self, path: str, value: float, share: float) -> float:
        """A value at most ``share`` of its range away from another."""
        gene = self._space.by_path[path]
        if not self._space.varies(gene):
            return value
        away = share * (gene.grid.high - gene.grid.low)
        span = max(gene.grid.low, value - away), min(gene.grid.high, value + away)
        return gene.grid.value(gene.grid.snap(float(self._rng.uniform(*span))))

    def _accepts(self, slot: str, name: str, values: Values) -> bool:
        space, model = self._space, self._space.catalogue[name]
        placement = space.composer.placement(values, slot, name)
        here, nearest = (placement.x, placement.y), space.operators.min_distance
        if any(math.dist(here, other.centre) < nearest for _, _, other in self._placed):
            # Checked first, since most draws fail by it
            self.reason = f"{placement.object} comes closer than {nearest:g} m to another object"
            return False
        outline = footprint(placement, model)
        named, others = (model.spoken, outline), [(other.spoken, around) for _, other, around in self._placed]
        problem = checks.off_workspace(*named, space.rig)
        problem = problem or next(filter(None, (checks.too_close(named, other, nearest) for other in others)), None)
        if slot.startswith("targets"):
            problem = problem or checks.out_of_reach(*named, space.rig)
            problem = problem or checks.out_of_view(placement, model, space.rig, camera(values))
        self.reason = problem or ""
        if not problem:
            self._placed.append((placement, model, outline))
        return not problem
