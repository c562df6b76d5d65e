"""Stages of a task of LIBERO: for each thing to be carried reach, grasp and move; then the task's goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.sim.libero.env import LiberoEnv
from vlafuzz.sim.libero.suites import LiberoTask

Array = NDArray[np.float64]
NEAR = 0.02  # metres between the hand's centre and the boxes about an object's shapes, for reach
MOVED = 0.05  # metres from its place at the start, for move
STEPS = 2  # consecutive control steps for which a stage must hold
PLACING = ("on", "in")  # predicates whose first thing is to be carried to the second


def carried(task: LiberoTask) -> tuple[str, ...]:
    """Names of the things that a task's goal wants elsewhere, in its order."""
    return tuple(atom[1] for atom in task.goal if atom[0] in PLACING)


def stage_names(task: LiberoTask) -> tuple[str, ...]:
    """``reach``, ``grasp``, ``move`` and ``goal``; the first three numbered if several things are carried."""
    count = len(carried(task))
    suffixes = [""] if count == 1 else [f" {number}" for number in range(1, count + 1)]
    return (*(stage + suffix for suffix in suffixes for stage in ("reach", "grasp", "move")), "goal")


@dataclass(frozen=True, eq=False)
class Shapes:
    """The colliding shapes of a thing in a model, by their numbers."""

    geoms: NDArray[np.int64]
    body: int


class Stages:
    """Tracks which stages a rollout has reached. It begins with the environment's present state.

    Stages are reached in order; the goal implies those before it.
    """

    def __init__(self, env: LiberoEnv) -> None:
        self._env, self.names = env, stage_names(env.task)
        self._things = [find_shapes(env, name) for name in carried(env.task)]
        self._start = [env.data.xpos[thing.body].copy() for thing in self._things]
        self._hand = env.robosuite.robots[0].eef_site_id
        self._streak = self._solved = 0
        self.reached: list[str] = []

    @property
    def success(self) -> bool:
        """Whether the goal has held for long enough at any step."""
        return len(self.reached) == len(self.names)

    def observe(self) -> None:
        """Look at the environment after a control step."""
        if self.success:
            return
        self._solved = self._solved + 1 if self._env.solved() else 0
        if self._solved >= STEPS:
            self.reached = list(self.names)
            return
        if len(self.reached) < len(self.names) - 1:
            self._streak = self._streak + 1 if self._holds(len(self.reached)) else 0
            if self._streak >= STEPS:
                self.reached.append(self.names[len(self.reached)])
                self._streak = 0

    def _holds(self, stage: int) -> bool:
        number, kind = divmod(stage, 3)
        thing = self._things[number]
        if kind == 0:
            return distance(self._env, thing, self._env.data.site_xpos[self._hand]) < NEAR
        if kind == 1:
            return held(self._env, thing)
        return float(np.linalg.norm(self._env.data.xpos[thing.body] - self._start[number])) > MOVED


def find_shapes(env: LiberoEnv, name: str) -> Shapes:
    """The colliding shapes of an object or piece of furniture that the problem names."""
    body = env.robosuite.obj_body_id[name]
    model = env.model
    geoms = np.flatnonzero((model.body_rootid[model.geom_bodyid] == body) & (model.geom_contype > 0))
    return Shapes(geoms, body)


def held(env: LiberoEnv, thing: Shapes) -> bool:
    """Whether both fingers touch a thing."""
    gripper, number = env.robosuite.robots[0].gripper, env.robosuite.sim.model.geom_name2id
    touching = touched(env, thing)
    sides = (gripper.important_geoms[side] for side in ("left_finger", "right_finger"))
    return all(touching & set(map(number, geoms)) for geoms in sides)


def touched(env: LiberoEnv, thing: Shapes) -> set[int]:
    """The numbers of the geoms that touch a thing's own."""
    own = set(thing.geoms.tolist())
    pairs = [set(pair) for pair in env.data.contact.geom.tolist()]
    return {other for pair in pairs if pair & own for other in pair - own}


def distance(env: LiberoEnv, thing: Shapes, point: Array) -> float:
    """Metres from a point to the nearest of the boxes about a thing's shapes."""
    geoms, model, data = thing.geoms, env.model, env.data
    turned = data.geom_xmat[geoms].reshape(-1, 3, 3)
    inside = np.einsum("nij,ni->nj", turned, point - data.geom_xpos[geoms]) - model.geom_aabb[geoms, :3]
    outside = np.maximum(np.abs(inside) - model.geom_aabb[geoms, 3:], 0.0)
    return float(np.linalg.norm(outside, axis=1).min())
