"""Stages of a task of LIBERO: for each thing to be carried reach, grasp and move; then the task's goal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.task import Monitor, Stage, Task
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.suites import LiberoTask, find_task

Array = NDArray[np.float64]
NEAR = 0.02  # metres between the hand's centre and the boxes about an object's shapes, for reach
MOVED = 0.05  # metres from its place at the start, for move
FAR = 0.4  # metres at which the nearness of reach and goal is 0


@dataclass(frozen=True, eq=False)
class Shapes:
    """The colliding shapes of a thing in a model, by their numbers."""

    geoms: NDArray[np.int64]
    body: int


class Moment:
    """An environment, as stages look at it. It begins with the environment's present state.

    Attributes:
        start: where the things to be carried were then, metres.
    """

    def __init__(self, env: LiberoEnv) -> None:
        self.env = env
        self.things = [find_shapes(env, name) for name in env.task.carried]
        self.start = [env.data.xpos[thing.body].copy() for thing in self.things]
        self.hand = env.robosuite.robots[0].eef_site_id

    def away(self, number: int) -> float:
        """Metres between the hand's centre and a thing."""
        return distance(self.env, self.things[number], self.env.data.site_xpos[self.hand])

    def moved(self, number: int) -> float:
        """Metres by which a thing has been moved."""
        return float(np.linalg.norm(self.env.data.xpos[self.things[number].body] - self.start[number]))

    def missing(self) -> float:
        """Metres, horizontally, from the things to their goals, on average."""
        if not self.things:
            return FAR
        return float(np.mean([self._from_goal(index) for index in range(len(self.things))]))

    def _from_goal(self, number: int) -> float:
        env = self.env
        goal = next(atom[2] for atom in env.task.goal if atom[1] == env.task.carried[number])
        bodies = env.bodies
        place = env.data.xpos[bodies[goal]] if goal in bodies else env.data.site(goal).xpos
        return float(np.linalg.norm((env.data.xpos[self.things[number].body] - place)[:2]))


def monitor_of(env: LiberoEnv) -> Monitor:
    """A monitor of a rollout that begins now. It observes a ``Moment`` of the environment."""
    stages = find_stages(env.task)
    return Monitor(stages, stages[-1].holds)


def find_stages(task: LiberoTask) -> tuple[Stage, ...]:
    """``reach``, ``grasp``, ``move`` and ``goal``; the first three numbered if several things are carried."""
    count = len(task.carried)
    suffixes = [""] if count == 1 else [f" {number}" for number in range(1, count + 1)]
    carrying = [
        stage
        for number, suffix in enumerate(suffixes)
        for stage in (
            Stage(f"reach{suffix}", partial(_reached, number), partial(_nearly_reached, number)),
            Stage(f"grasp{suffix}", partial(_grasped, number), partial(_nearly_grasped, number)),
            Stage(f"move{suffix}", partial(_moved, number), partial(_nearly_moved, number)),
        )
    ]
    return (*carrying, Stage("goal", _solved, _nearly_solved))


def _reached(number: int, moment: Moment) -> bool:
    return moment.away(number) < NEAR


def _nearly_reached(number: int, moment: Moment) -> float:
    return 1 - moment.away(number) / FAR


def _grasped(number: int, moment: Moment) -> bool:
    return held(moment.env, moment.things[number])


def _nearly_grasped(number: int, moment: Moment) -> float:
    return 0.5 * (moment.away(number) < NEAR)


def _moved(number: int, moment: Moment) -> bool:
    return moment.moved(number) > MOVED


def _nearly_moved(number: int, moment: Moment) -> float:
    return moment.moved(number) / MOVED


def _solved(moment: Moment) -> bool:
    return moment.env.solved()


def _nearly_solved(moment: Moment) -> float:
    return 1 - moment.missing() / FAR


def find_shapes(env: LiberoEnv, name: str) -> Shapes:
    """The colliding shapes of an object or piece of furniture that the problem names."""
    body = env.bodies[name]
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


@cache
def task(name: str) -> Task:
    """The task that ``SUITE/NUMBER`` names. Its situations are a ``Moment`` each.

    Raises:
        UsageError: there is no such suite or task.
        PrerequisiteError: LIBERO is not installed.
    """
    found = find_task(name)
    stages = find_stages(found)
    return Task(name, len(found.things), stages, stages[-1].holds)
