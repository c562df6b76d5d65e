"""The scenes of LIBERO: the suites' own initial states, and what the operators make of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np
from pydantic import TypeAdapter

from vlafuzz.assets import operators_dir
from vlafuzz.errors import CatalogueError, UsageError
from vlafuzz.reading import read_yaml, validated
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Placement, Scene
from vlafuzz.sim.libero.room import room_of
from vlafuzz.sim.libero.suites import REST, LiberoTask, find_task, find_tasks
from vlafuzz.sim.libero.tasks import task as task_named
from vlafuzz.space import OperatorSet, SearchSpace
from vlafuzz.space.base import Layout, Span
from vlafuzz.space.compose import PARTS, Composer, Values, camera, index_of
from vlafuzz.space.generate import HINT, REDRAWS, RESTARTS
from vlafuzz.space.operators import (
    EXTRAS,
    CameraOrientation,
    CameraPosition,
    ConfounderOrientation,
    ConfounderPosition,
    Light,
    TargetOrientation,
    TargetPosition,
    Wording,
)
from vlafuzz.space.params import Gene, Grid
from vlafuzz.tasks.base import Task

RIDING = 0.2  # of the range for a thing that stands on another one: farther, and it would fall off
_WORDINGS = TypeAdapter(list[str])
_PLACING = (TargetPosition, TargetOrientation, ConfounderPosition, ConfounderOrientation)
# Operators that are the same as on the tabletop, beside the extras. LIBERO has no backdrops of ours.
_SHARED = (
    Light.name,
    CameraPosition.name,
    CameraOrientation.name,
    Wording.name,
    *sorted(EXTRAS - {"backdrop"}),
)


def nominal_scene(task: str, robot: str) -> Scene:
    """The suite's own initial state 0, with nothing changed."""
    found = find_task(task)
    things = tuple(Placement(name, REST, 0.0, 0.0) for name in found.things)
    return Scene(task, things, found.instruction, robot=robot)


@cache
def load_wordings() -> tuple[str, ...]:
    """How an instruction is said, ``{instruction}`` standing for the suite's own, which comes first.

    Raises:
        CatalogueError: the file is malformed, or a wording lacks the instruction.
    """
    path, hint = operators_dir() / "libero-wordings.yaml", "expected a list of wordings"
    wordings = validated(_WORDINGS, read_yaml(path, CatalogueError, hint), path, CatalogueError, hint)
    for wording in wordings:
        if "{instruction}" not in wording:
            raise CatalogueError(f"{path}: {wording!r} does not say {{instruction}}", hint)
    return tuple(wordings)


class LiberoComposer(Composer):
    """Composes scenes of one task. Places are offsets from an initial state, so that nominal is zero."""

    def __init__(self, operators: OperatorSet, task: LiberoTask, robot: str) -> None:
        self._libero, self._nominal = task, nominal_scene(str(task), robot)
        wordings = [wording.replace("{instruction}", task.instruction) for wording in load_wordings()]
        self._said = tuple(dict.fromkeys(wordings))
        self.layout = Layout({}, {}, 1, len(self._said), rig(robot))
        placing = [gene for kind in _PLACING for gene in self._placing(operators, kind.name)]
        shared = [gene for name in _SHARED for gene in operators.operators[name].genes(self.layout)]
        self.genes = [*placing, *shared]
        self._fields = {part: [gene for gene in self.genes if gene.slot == part] for part in PARTS}

    def _placing(self, operators: OperatorSet, name: str) -> Iterator[Gene]:
        """The genes of places or yaws: of what the task is about, or of what stands around."""
        operator, concerned = operators.operators[name], self._libero.concerned
        around = name in (ConfounderPosition.name, ConfounderOrientation.name)
        slots = range(concerned, len(self._libero.things)) if around else range(concerned)
        for slot in slots:
            share = RIDING if self._libero.things[slot] in self._libero.riders else 1.0
            if isinstance(operator, (TargetPosition, ConfounderPosition)):
                yield Gene(name, f"targets.{slot}.x", "real", _grid(operator.x, share))
                yield Gene(name, f"targets.{slot}.y", "real", _grid(operator.y, share))
            elif isinstance(operator, (TargetOrientation, ConfounderOrientation)):
                yield Gene(name, f"targets.{slot}.yaw", "real", operator.yaw.grid(0.0))

    def compose(self, values: Mapping[str, float]) -> Scene:
        """The scene with these values."""
        placed = tuple(
            Placement(name, REST, *(values[f"targets.{slot}.{part}"] for part in ("x", "y", "yaw")))
            for slot, name in enumerate(self._libero.things)
        )
        return Scene(
            task=self._nominal.task,
            targets=placed,
            instruction=self._said[int(values["instruction"])],
            camera=camera(values),
            robot=self._nominal.robot,
            **{part: self._composed(part, values) for part in PARTS},
        )

    def values(self, scene: Scene) -> Values:
        """The values of everything that a scene has; NaN where no index stands for it."""
        values = self._shared_values(scene)
        for slot, placement in enumerate(scene.targets):
            known = placement.object == self._libero.things[slot] and placement.quaternion is None
            for part in ("x", "y", "yaw"):
                values[f"targets.{slot}.{part}"] = getattr(placement, part) if known else math.nan
        return values | {"instruction": math.nan if scene.then else index_of(self._said, scene.instruction)}


def _grid(span: Span, share: float) -> Grid:
    """A share of a range about zero."""
    return Grid(share * span.low, share * span.high, span.step, 0.0)


class LiberoSpace(SearchSpace):
    """Every scene that the operators can make of a task's initial states."""

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene with room for everything. What else is fair is judged by physics, before a rollout.

        Raises:
            UsageError: the ranges leave no room.
        """
        for _ in range(RESTARTS):
            drawn = self.composer.compose({path: self.draw(path, rng) for path in self.by_path})
            if (scene := self.repaired(drawn, rng)) is not None:
                return scene
        raise UsageError(f"{self.task.name}: no scene in these ranges has room for everything", hint=HINT)

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene, with things moved that are too close to others or out of reach; None without room."""
        room = room_of(self.task.name)
        for _ in range(REDRAWS):
            if not (misplaced := room.crowded(scene) | room.out_of_reach(scene).keys()):
                return scene
            slot = f"targets.{rng.choice(sorted(misplaced))}"
            again = {path: self.draw(path, rng) for path in (f"{slot}.x", f"{slot}.y")}
            scene = self.composer.compose(self.values(scene) | again)
        return None

    def misnamed(self, scene: Scene) -> str | None:
        """The instruction of another task of the suite, if possible about something that is here."""
        task = find_task(self.task.name)
        others = [other for other in find_tasks(task.suite) if other.instruction != task.instruction]
        here = [other for other in others if other.carried and set(other.carried) < set(task.things)]
        return next((other.instruction for other in here + others), None)

    def _find_task(self, name: str) -> Task:
        return task_named(name)

    def _make_composer(self) -> Composer:
        return LiberoComposer(self.operators, find_task(self.task.name), self.rig.robot)
