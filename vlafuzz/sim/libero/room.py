"""Where the things of a task have room and are in reach: known before anything is simulated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.processor import kept
from vlafuzz.rigs.robots import LIBERO
from vlafuzz.scene import Scene
from vlafuzz.sim.libero.env import LiberoEnv
from vlafuzz.sim.libero.grasps import surface
from vlafuzz.sim.libero.packages import versions
from vlafuzz.sim.libero.suites import LiberoTask, find_task

Array = NDArray[np.float64]
OUTLINE = 1500  # points of a thing's surface
SLACK = 0.005  # metres by which two things may come closer than in the initial state


@dataclass(frozen=True, eq=False)
class Room:
    """Where things stand in the initial states, and how far they reach.

    Attributes:
        places: ``(states, things, 2)`` of their middles, metres.
        radii: ``(things,)`` of circles about them, metres.
        base: ``(2,)`` of the robot, metres.
        concerned: the number of things that the task is about; they come first.
        carriers: ``(things,)`` what each stands on, itself for most.
        pairs: of things that may not overlap: neither stands on the other.
    """

    places: Array
    radii: Array
    base: Array
    concerned: int
    carriers: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]

    def crowded(self, scene: Scene) -> set[int]:
        """The things that come too close to another one: nearer than in the initial state, and too near."""
        start, now = self.places[scene.start.state], self._now(scene)
        found: set[int] = set()
        for a, b in self.pairs:
            apart, before = (float(np.linalg.norm(at[a] - at[b])) for at in (now, start))
            if apart < min(self.radii[a] + self.radii[b], before - SLACK):
                found |= {a, b}
        return found

    def out_of_reach(self, scene: Scene) -> dict[int, float]:
        """The things that the task is about and the robot does not reach, with their distance from its base.

        What is as near as in the initial state counts as in reach.
        """
        start, now = self.places[scene.start.state], self._now(scene)
        found: dict[int, float] = {}
        for thing in range(self.concerned):
            away, before = (float(np.linalg.norm(at[thing] - self.base)) for at in (now, start))
            if away > max(LIBERO.reach, before):
                found[thing] = away
        return found

    def _now(self, scene: Scene) -> Array:
        """``(things, 2)`` of their middles; what stands on something goes along with it."""
        own = np.array([(one.x, one.y) for one in scene.targets])
        along = [own[on] if on != thing else 0.0 * own[on] for thing, on in enumerate(self.carriers)]
        return np.asarray(self.places[scene.start.state] + own + along)


@cache
def room_of(name: str) -> Room:
    """The room in a task; looking takes seconds once on a machine."""
    task = find_task(name)
    places, radii, base = kept(f"libero-room-{name.replace('/', '-')}", lambda: _look(task), str(versions()))
    carriers = tuple(task.things.index(task.riders.get(name, name)) for name in task.things)
    pairs = tuple(
        (a, b) for a, b in combinations(range(len(task.things)), 2) if carriers[a] != b and carriers[b] != a
    )
    return Room(np.array(places), np.array(radii), np.array(base), task.concerned, carriers, pairs)


def _look(task: LiberoTask) -> list[Any]:
    env = LiberoEnv(task)
    bodies = [env.robosuite.obj_body_id[name] for name in task.things]
    places, radii = list[Any](), list[float]()
    for number in range(len(env.states)):
        env.reset(number)
        places.append(env.data.xpos[bodies][:, :2].tolist())
    for body, place in zip(bodies, places[-1], strict=True):
        outline = surface(env, body, OUTLINE)[:, :2] - place
        radii.append(float(np.linalg.norm(outline, axis=1).max()))
    base = env.robosuite.robots[0].base_pos[:2].tolist()
    env.close()
    return [places, radii, base]
