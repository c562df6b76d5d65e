"""SearchSpace: random generation by VLATest's Algorithm 1, with every precondition that the paper states.

Objects are drawn without replacement by their spoken names. Draws that the task does not allow
(``semantic_valid``) or that have no room (``safe_dist``) are rejected. Rejection is bounded: first a position
is redrawn, then the whole scene, then generation fails.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vlafuzz.common.text import ambiguous
from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Camera, Placement, Scene
from vlafuzz.model.space import Values
from vlafuzz.worlds.manipulation.operator_set import OperatorSet
from vlafuzz.worlds.manipulation.operators import TargetPosition
from vlafuzz.worlds.manipulation.parts import HINT, REDRAWS, RESTARTS, camera
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.manipulation.space import TableSpace
from vlafuzz.worlds.tabletop.fairness.checks import (
    cannot_grasp,
    cannot_place,
    off_workspace,
    out_of_reach,
    out_of_view,
    too_close,
)
from vlafuzz.worlds.tabletop.fairness.footprint import Footprint, footprint
from vlafuzz.worlds.tabletop.fairness.visible import unseen
from vlafuzz.worlds.tabletop.instructions import load_wordings, say
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.objects.stored import packs_json
from vlafuzz.worlds.tabletop.space.compose import Composer
from vlafuzz.worlds.tabletop.tasks import task as task_named

_NEAREST = ("confounder-position", "distance of the nearest confounder from the target")


class SearchSpace(TableSpace):
    """Every scene that the operators can make of a task, with random generation and repair."""

    def __init__(self, operators: OperatorSet, catalogue: Catalogue, task: str, robot: str = "panda") -> None:
        found, of_task = task_named(task), operators.in_task(task)
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
        """A random scene that passes the checks before settling.

        Raises:
            UsageError: the ranges leave no room for the objects.
        """
        # Drawn outside the restarts, so that crowded scenes are not rarer than others.
        count = self.draw("confounders", rng)
        attempt = Attempt(self, rng)
        for _ in range(RESTARTS):
            values = attempt.values(count)
            if values is None:
                continue
            scene = self.composer.compose(values)
            if not (problem := self._unseen(scene)):
                return scene
            attempt.reason = problem
        box = self.operators.get(TargetPosition).ranges()
        objects = f"{self.task.targets} target(s) and {int(count)} confounder(s)"
        raise UsageError(
            f"{self.task.name}: no scene of {objects}, {self.operators.min_distance:g} m apart, in {box}; "
            f"the last of {RESTARTS} attempts: {attempt.reason}",
            hint=HINT,
        )

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene with as little redrawn as it takes to pass these checks; None when there is no room.

        Objects are placed in order, targets first, so that confounders give way to targets. A scene whose
        targets cannot be seen is not repaired: None.
        """
        attempt, values = Attempt(self, rng), self.values(scene)
        slots = self.composer.layout.used(len(scene.confounders))
        kept = all(attempt.keep(slot, values) for slot in slots)
        moved = self.composer.compose(values) if kept else None
        return None if moved is None or self._unseen(moved) else moved

    def misnamed(self, scene: Scene) -> str | None:
        """The instruction with a confounder's name instead of the first target's; None without one."""
        if not scene.confounders:
            return None
        objects = (scene.confounders[0], *scene.targets[1:])
        names = [self.catalogue[placed.object].spoken for placed in objects]
        return say(load_wordings()[scene.task][0], names)

    def _unseen(self, scene: Scene) -> str | None:
        """Why a target cannot be seen, if that is checked."""
        visible = self.operators.visible
        return unseen(scene, self.catalogue, visible) if visible else None

    def derived(self, scene: Scene) -> Mapping[tuple[str, str], float]:
        target, *_ = scene.targets
        places = [(other.x - target.x, other.y - target.y) for other in scene.confounders]
        if not places:
            return {}
        return {_NEAREST: min(round(float(np.hypot(*place)), 3) for place in places)}


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

        An object that the task does not allow beside those placed before gets another rest pose, else another
        type. One without room is moved, each time a little farther from where it was.
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
        yield from self._rng.permutation(size).tolist()

    def _senseless(self, slot: str, placement: Placement, model: ObjectModel) -> str | None:
        if slot == "targets.0":
            return cannot_grasp(placement, model, self._space.rig.hand)
        onto = self._space.onto
        if slot == "targets.1" and onto:
            return cannot_place(onto, *self._placed[0][:2], placement, model)
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
        """Place an object where the values say, if there is room."""
        model = self._space.catalogue[name]
        placement = self._space.composer.placement(values, slot, name)
        if self._crowded(placement):
            return False
        outline = footprint(placement, model)
        watched = camera(values) if slot.startswith("targets") else None
        self.reason = self._misplaced(placement, model, outline, watched) or ""
        if self.reason:
            return False
        self._placed.append((placement, model, outline))
        return True

    def _crowded(self, placement: Placement) -> bool:
        """Whether another centre is too close: checked first, since most draws fail by it."""
        here, nearest = (placement.x, placement.y), self._space.operators.min_distance
        if all(math.dist(here, other.centre) >= nearest for _, _, other in self._placed):
            return False
        self.reason = f"{placement.object} comes closer than {nearest:g} m to another object"
        return True

    def _misplaced(
        self, placement: Placement, model: ObjectModel, outline: Footprint, watched: Camera | None
    ) -> str | None:
        setup, named = self._space.rig, (model.spoken, outline)
        if problem := off_workspace(*named, setup):
            return problem
        for _, other, around in self._placed:
            if problem := too_close(named, (other.spoken, around), self._space.operators.min_distance):
                return problem
        if watched is None:
            return None
        return out_of_reach(*named, setup) or out_of_view(placement, model, setup, watched)
