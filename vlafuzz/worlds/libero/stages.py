"""Stages of a task of LIBERO: for each thing to be carried reach, grasp and move; then the task's goal."""

from collections.abc import Iterator
from functools import cache

import numpy as np

from vlafuzz.model import Stage, Task
from vlafuzz.worlds.events import Looked
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.suites import LiberoTask, find_task

NEAR = 0.02  # metres between the hand's centre and the boxes about an object's shapes, for reach
MOVED = 0.05  # metres from its place at the start, for move
FAR = 0.4  # metres at which the nearness of reach and goal is 0


class Moment:
    """An environment, as stages look at it. It begins with the environment's present state."""

    def __init__(self, env: LiberoEnv) -> None:
        self.env = env
        self._start = [env.place(name) for name in env.task.carried]

    def away(self, number: int) -> float:
        """Metres between the hand's centre and the nearest of the boxes about a thing's shapes."""
        env, geoms = self.env, self.env.away.shapes[self.env.task.carried[number]]
        model, data = env.model, env.data
        hand = data.site_xpos[env.robosuite.robots[0].eef_site_id]
        turned = data.geom_xmat[geoms].reshape(-1, 3, 3)
        inside = np.einsum("nij,ni->nj", turned, hand - data.geom_xpos[geoms]) - model.geom_aabb[geoms, :3]
        outside = np.maximum(np.abs(inside) - model.geom_aabb[geoms, 3:], 0.0)
        return float(np.linalg.norm(outside, axis=1).min())

    def held(self, number: int) -> bool:
        return held(self.env, self.env.task.carried[number])

    def moved(self, number: int) -> float:
        """Metres by which a thing has been moved."""
        return float(np.linalg.norm(self.env.place(self.env.task.carried[number]) - self._start[number]))

    def missing(self) -> float:
        """Metres, horizontally, from the things to their goals, on average."""
        env, ways = self.env, []
        for name in env.task.carried:
            goal = next(atom[2] for atom in env.task.goal if atom[1] == name)
            there = env.place(goal) if goal in env.bodies else env.data.site(goal).xpos
            ways.append(np.linalg.norm((env.place(name) - there)[:2]))
        return float(np.mean(ways)) if ways else FAR


def find_stages(task: LiberoTask) -> tuple[Stage, ...]:
    """``reach``, ``grasp``, ``move`` and ``goal``; the first three numbered if several things are carried."""
    count = len(task.carried)
    suffixes = [""] if count == 1 else [f" {number}" for number in range(1, count + 1)]
    carrying = (stage for number, suffix in enumerate(suffixes) for stage in _carrying(number, suffix))
    goal = Stage("goal", lambda now: now.env.solved(), lambda now: 1 - now.missing() / FAR)
    return (*carrying, goal)


def _carrying(thing: int, suffix: str) -> Iterator[Stage]:
    yield Stage(f"reach{suffix}", lambda now: now.away(thing) < NEAR, lambda now: 1 - now.away(thing) / FAR)
    yield Stage(f"grasp{suffix}", lambda now: now.held(thing), lambda now: 0.5 * (now.away(thing) < NEAR))
    yield Stage(f"move{suffix}", lambda now: now.moved(thing) > MOVED, lambda now: now.moved(thing) / MOVED)


def looked_at(now: Moment) -> Looked:
    """Look at what tells whether the robot stands still."""
    env, names = now.env, now.env.task.things
    bodies, data = [env.bodies[name] for name in names], env.data
    hand = data.site_xpos[env.robosuite.robots[0].eef_site_id].copy()
    holding = np.array([held(env, name) for name in names])
    return Looked(hand, data.xpos[bodies, 2], data.xmat[bodies].reshape(-1, 3, 3)[:, 2], holding)


def held(env: LiberoEnv, name: str) -> bool:
    """Whether both fingers touch a thing that can be moved."""
    gripper, number = env.robosuite.robots[0].gripper, env.robosuite.sim.model.geom_name2id
    own = set(env.away.shapes[name].tolist())
    pairs = [set(pair) for pair in env.data.contact.geom.tolist()]
    touching = {other for pair in pairs if pair & own for other in pair - own}
    sides = (gripper.important_geoms[side] for side in ("left_finger", "right_finger"))
    return all(touching & set(map(number, geoms)) for geoms in sides)


@cache
def task(name: str) -> Task:
    """The task that ``SUITE/NUMBER`` names, whose situations are a ``Moment`` each; errors as of ``find_tasks``."""
    found = find_task(name)
    return Task(name, len(found.things), find_stages(found))
