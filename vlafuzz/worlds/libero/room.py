"""Where the things of a task have room and are in reach: known before anything is simulated."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.common.assets import kept
from vlafuzz.model import Scene
from vlafuzz.worlds.libero.casts import about, pool
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.grasps import surface
from vlafuzz.worlds.libero.packages import versions
from vlafuzz.worlds.libero.setting import OUTLINE, Standing
from vlafuzz.worlds.libero.suites import PLACING, LiberoTask, find_task
from vlafuzz.worlds.manipulation.rigs import LIBERO

REACH = LIBERO.reach
VERSION = 2  # raise it when looking finds something else
MANY = 20_000  # points of a piece of furniture
SLACK = 0.005  # metres by which two things may come closer than in the initial state


@dataclass(frozen=True, eq=False)
class Room:
    """The places and sizes of a task's things in the initial states. All numbers are in metres.

    Attributes:
        places: ``(states, things, 2)`` of their middles; ``radii``: ``(things,)`` of circles about them. base: ``(2,)``
        of the robot.
        taken: ``(n, 2)`` points on furniture, and where something is to be put.
    """

    task: LiberoTask
    places: Array
    radii: Array
    base: Array
    taken: Array

    def crowded(self, scene: Scene) -> set[int]:
        """The things that come too close to another one: nearer than in the initial state, and too near.

        By their numbers among the scene's placements. Confounders give way to the others.
        """
        start, now = self.places[scene.start.state], self._now(scene)
        radii, on, found = self._radii(scene), self._carriers, set[int]()
        for a, b in combinations(range(len(now)), 2):
            apart, before = (float(np.linalg.norm(at[a] - at[b])) for at in (now, start))
            if on[a] != b and on[b] != a and apart < min(radii[a] + radii[b], before - SLACK):
                found |= {a, b}
        for thing in range(len(now)):
            apart, before = (self._from_furniture(at[thing]) for at in (now, start))
            if apart < min(radii[thing], before - SLACK):
                found.add(thing)
        for number, placed in enumerate(scene.confounders, len(now)):
            place = np.array([placed.x, placed.y])
            apart = float((np.linalg.norm(now - place, axis=1) - radii[:number]).min())
            if min(apart, self._from_furniture(place)) < radii[number]:
                found.add(number)
            now = np.concatenate([now, place[None]])
        return found

    def out_of_reach(self, scene: Scene) -> dict[int, float]:
        """The things that a scene is about and the robot does not reach, with their distance from its base.

        What is as near as in the initial state counts as in reach.
        """
        away, before = (
            np.linalg.norm(at - self.base, axis=1) for at in (self._now(scene), self.places[scene.start.state])
        )
        return {one: float(away[one]) for one in about(self.task, scene) if away[one] > max(REACH, before[one])}

    @cached_property
    def _carriers(self) -> list[int]:
        """The number of the thing that each thing stands on, its own for most."""
        things, riders = self.task.things, self.task.riders
        return [things.index(riders.get(name, name)) for name in things]

    def _now(self, scene: Scene) -> Array:
        """``(things, 2)`` of their middles; what stands on something goes along with it."""
        own = np.array([(one.x, one.y) for one in scene.targets])
        along = [own[on] if on != thing else 0.0 * own[on] for thing, on in enumerate(self._carriers)]
        return np.asarray(self.places[scene.start.state] + own + along)

    def _radii(self, scene: Scene) -> Array:
        """``(n,)`` of all placements."""
        known = dict(zip(self.task.things, self.radii.tolist(), strict=True))
        if any(placed.object not in known for placed in scene.placements):
            known |= _added_radii(scene.task)
        return np.array([known[placed.object] for placed in scene.placements])

    def _from_furniture(self, place: Array) -> float:
        return float(np.linalg.norm(self.taken - place, axis=1).min(initial=np.inf))


@cache
def room_of(name: str) -> Room:
    task = find_task(name)
    places, radii, base, taken = map(np.array, _once("room", task, _look))
    return Room(task, places, radii, base, taken.reshape(-1, 2))


@cache
def _added_radii(name: str) -> dict[str, float]:
    task = find_task(name)
    return dict(_once("added", task, _look_at_added, pool(task)))


def _once(what: str, task: LiberoTask, look: Callable[[LiberoTask], Any], *given: object) -> Any:
    """Look, which takes seconds, once on a machine; later the result is read from the cache."""
    name = f"libero-{what}-{str(task).replace('/', '-')}"
    return kept(name, lambda: look(task), VERSION, str(versions()), *given)


def _look(task: LiberoTask) -> list[Any]:
    env = LiberoEnv(task)
    bodies = [env.bodies[name] for name in task.things]
    places = list[Any]()
    for number in range(len(env.states)):
        env.reset(number)
        places.append(env.data.xpos[bodies][:, :2].tolist())
    radii = [_radius(env, body) for body in bodies]
    base = env.robosuite.robots[0].base_pos[:2].tolist()
    furniture = [body for name, body in env.bodies.items() if name not in env.movable]
    sites = [atom[2] for atom in task.goal if atom[0] in PLACING and atom[2] not in env.bodies]
    taken = [surface(env, body, MANY)[:, :2] for body in furniture]
    taken += [env.data.site(site).xpos[None, :2] for site in sites]
    points = np.concatenate([np.zeros((0, 2)), *taken])
    env.close()
    return [places, radii, base, np.unique(points.round(2), axis=0).tolist()]  # a centimetre apart


def _look_at_added(task: LiberoTask) -> dict[str, float]:
    env = LiberoEnv(task, more=pool(task))
    standing = Standing(env)
    env.cast(task, env.more)
    radii = dict[str, float]()
    for name in env.more:
        standing.show(name)
        radii[name] = _radius(env, env.bodies[name])
    env.close()
    return radii


def _radius(env: LiberoEnv, body: int) -> float:
    """The radius, metres, of the circle around a body, seen from above, that contains its surface."""
    outline = surface(env, body, OUTLINE)[:, :2] - env.data.xpos[body, :2]
    return float(np.linalg.norm(outline, axis=1).max())
