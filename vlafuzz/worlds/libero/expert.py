"""A scripted expert for LIBERO's pick-and-place tasks: sees the simulator's state, acts as models do.

Also as a policy, and in the place of a policy whose actions it writes.
"""

from collections.abc import Callable, Generator, Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.clients.model import Interface, Written
from vlafuzz.worlds.base import Acting, Scripted
from vlafuzz.worlds.events import STAY
from vlafuzz.worlds.libero.env import HZ, METRES, RADIANS, UNITS, LiberoEnv
from vlafuzz.worlds.libero.grasps import Grasp, find_grasps, obstacles, surface
from vlafuzz.worlds.libero.stages import held
from vlafuzz.worlds.libero.suites import PLACING, Atom

HOVER = 0.08  # metres above a grasp, from where the hand comes down
CARRY = 0.06  # metres between what is carried and all that stands around
DROP = 0.01  # metres above its place at which a thing is let go
FAST = 2.0  # errors are asked for that many times: the controller covers a part of them in a step
DROPPED = 0.05  # metres by which a thing that was grasped is farther below the hand; in the hand, it turns by less
SLID = 0.01  # metres by which a thing has been moved, and is grasped anew, while the hand comes near
CLOSE = 0.008  # metres from a place that count as there
PATIENCE = 60  # control steps for one move
STUCK = 8  # control steps without a millimetre of movement that end a move, too
FAR, STALLED = 0.03, 12  # metres from a place from which on it takes more of them than those that an event takes away
SPREAD = 0.6  # of half a region's size: how far from its middle things go that share it
TILT = 0.02  # metres by which the end of a thing that is too long for its goal clears the far border: it tips in
TRIES = 4  # for each thing
OWN = ActionSpec(relative_to="current", hz=HZ)
Check = Callable[[], bool]


class Expert:
    """Solves a task from the environment's present state on.

    ``for action in Expert(env).actions(): env.step(action)``; it looks at the state before each action.

    Args:
        attempt: index of the grasp with which it begins.
        pace: control steps for which each action is executed.
        tries: for each thing.
    """

    def __init__(self, env: LiberoEnv, attempt: int = 0, *, pace: int = 1, tries: int = TRIES) -> None:
        self._env, self._pace = env, pace
        self._attempt, self._tries = attempt, tries
        self._gain = 1.0 if pace == 1 else 2.0
        self._site = env.robosuite.robots[0].eef_site_id
        self._upright = _level(env.data.site_xmat[self._site].reshape(3, 3))

    def actions(self) -> Iterator[Array]:
        """Actions ``(7,)`` until everything is at its place, or no try is left; at first, what is held is let go."""
        if any(held(self._env, name) for name in self._env.movable if name not in self._env.task.carried):
            yield from self._wait(5, gripper=-1.0)
            yield from self._move(self._shifted(up=HOVER), self._yaw(), gripper=-1.0)
        for atom in self._env.task.goal:
            attempt = self._attempt
            for _ in range(self._tries):
                if atom[0] not in PLACING or self._env.holds(atom):
                    break
                grasped = yield from self._place(atom, attempt)
                attempt += not grasped
        yield from self._wait(10, gripper=-1.0)

    def _place(self, atom: Atom, attempt: int) -> Generator[Array, None, bool]:
        """Bring a thing to its place; whether it was grasped."""
        _, name, goal = atom
        if held(self._env, name):
            yield from self._bring(name, goal, self._yaw())
            return True
        while True:
            grasps = find_grasps(self._env, name)
            if not grasps:
                yield from self._wait(5, gripper=-1.0)
                return False
            grasp, there = grasps[0] if attempt == 0 else _other(grasps, attempt), self._env.place(name)
            above = grasp.position + np.array([0.0, 0.0, HOVER])
            high = np.array([*above[:2], max(above[2], self._hand()[2])])
            yield from self._move(high, grasp.yaw, gripper=-1.0, close=0.03)
            yield from self._move(above, grasp.yaw, gripper=-1.0)
            if np.linalg.norm(self._env.place(name) - there) < SLID:
                break
        yield from self._move(grasp.position, grasp.yaw, gripper=-1.0, close=0.004)
        yield from self._wait(10, gripper=1.0)
        if not held(self._env, name):
            yield from self._move(self._shifted(up=HOVER), grasp.yaw, gripper=-1.0)
            return False
        yield from self._bring(name, goal, grasp.yaw)
        return True

    def _bring(self, name: str, goal: str, yaw: float) -> Iterator[Array]:
        """Carry what the hand holds over its goal, lower it and let go; end at once if it falls on the way."""
        below = self._below(name)

        def dropped() -> bool:
            return self._below(name) - below > DROPPED

        place, clear = self._goal(goal)
        share = self._share(name, goal)
        around = obstacles(self._env, name)  # such as the drawer that it lies in
        clear = max([clear, *around[:, 2]])
        up = max(clear + CARRY - self._lowest(name), 0.05)
        yield from self._move(self._shifted(up=up), yaw, gripper=1.0, close=0.015, until=dropped)
        for _ in range(2):  # a thing may turn in the hand on its way
            if dropped():
                return
            if np.linalg.norm((now := self._goal(goal)[0]) - place) > SLID:
                place = now
            aside = (place + share - self._env.place(name))[:2]
            yield from self._move(self._shifted(aside), yaw, gripper=1.0, close=0.01, until=dropped)
        down = place[2] + DROP - self._lowest(name)
        yield from self._move(self._shifted(up=down), yaw, gripper=1.0)
        yield from self._wait(8, gripper=-1.0)
        yield from self._move(self._shifted(up=HOVER), yaw, gripper=-1.0, close=0.03)

    def _goal(self, goal: str) -> tuple[Array, float]:
        """Where the lowest point of a thing is to go, and the height that its way there must clear."""
        env, bodies = self._env, self._env.bodies
        if goal in bodies:
            points = surface(env, bodies[goal], 3000)
            place = env.place(goal)
            inner = points[np.linalg.norm((points - place)[:, :2], axis=1) < 0.03]
            place[2] = inner[:, 2].max() if len(inner) else points[:, 2].max()
            return place, float(points[:, 2].max())
        site = env.data.site(goal)
        place = site.xpos.copy()
        parent = getattr(env.robosuite.object_sites_dict[goal], "parent_name", None)
        if parent not in bodies:
            return place, float(place[2])
        place[2] -= float(np.abs(site.xmat.reshape(3, 3) @ env.model.site_size[site.id])[2])
        points = surface(env, bodies[parent], 3000)
        near = points[np.linalg.norm((points - place)[:, :2], axis=1) < 0.2]
        return place, float(near[:, 2].max()) if len(near) else float(place[2])

    def _share(self, name: str, goal: str) -> Array:
        """Where a thing goes from the middle of a region on which others go too, or that is shorter than it is."""
        things = [atom[1] for atom in self._env.task.goal if atom[0] == "on" and atom[2] == goal]
        within = ("in", name, goal) in self._env.task.goal
        if len(things) < 2 and not within:
            return np.zeros(3)
        points = surface(self._env, self._env.bodies[name], 2000)
        half = self._env.model.site_size[self._env.data.site(goal).id]
        if within:
            _, _, ways = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), full_matrices=False)
            over = np.ptp(points[:, :2] @ ways[0]) / 2 - half[:2].max()
            return np.append((over + TILT) * ways[0], 0.0) if over > 0 else np.zeros(3)
        narrow = int(np.argmin(np.ptp(points[:, :2], axis=0)))  # side by side where they are narrow
        share = (2 * things.index(name) / (len(things) - 1) - 1) * SPREAD * half[narrow]
        return np.asarray(share * np.eye(3)[narrow])

    def _move(
        self, target: Array, yaw: float, *, gripper: float, close: float = CLOSE, until: Check = lambda: False
    ) -> Iterator[Array]:
        near = max(STUCK // self._pace, 2)
        earlier = [(np.full(3, np.inf), np.zeros(3))] * max(near, STALLED)
        for _ in range(PATIENCE // self._pace):
            hand, turn = self._hand(), self._turn(yaw)
            away = target - hand
            before, tilt = earlier[-near if np.linalg.norm(away) < FAR else -STALLED]
            level = min(np.linalg.norm(turn), 10 * np.linalg.norm(turn - tilt)) < 0.1  # or it can turn no further
            if until() or (level and (np.linalg.norm(away) < close or np.linalg.norm(hand - before) < 0.001)):
                return
            earlier.append((hand, turn))
            gain = self._gain / self._pace
            moved, turned = gain * FAST * away / METRES, gain * turn / RADIANS
            yield np.concatenate([np.clip(moved, -1, 1), np.clip(turned, -1, 1), [gripper]])

    def _wait(self, steps: int, *, gripper: float) -> Iterator[Array]:
        for _ in range(-(-steps // self._pace)):
            yield np.array([0.0] * 6 + [gripper])

    def _hand(self) -> Array:
        return np.array(self._env.data.site_xpos[self._site])

    def _below(self, name: str) -> float:
        return float(self._hand()[2] - self._env.place(name)[2])

    def _shifted(self, aside: Array | tuple[float, float] = (0.0, 0.0), *, up: float = 0.0) -> Array:
        return np.asarray(self._hand() + np.array([*aside, up]))

    def _turn(self, yaw: float) -> Array:
        """The rotation vector that brings the hand upright to a yaw."""
        wanted = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix() @ self._upright
        now = self._env.data.site_xmat[self._site].reshape(3, 3)
        return np.asarray(Rotation.from_matrix(wanted @ now.T).as_rotvec())

    def _yaw(self) -> float:
        """The hand's yaw from the robot's own, radians."""
        now = self._env.data.site_xmat[self._site].reshape(3, 3) @ self._upright.T
        return float(np.arctan2(now[1, 0], now[0, 0]))

    def _lowest(self, name: str) -> float:
        return float(surface(self._env, self._env.bodies[name], 2000)[:, 2].min())


def _level(rotation: Array) -> Array:
    """The nearest hand's rotation whose z points straight down."""
    x = rotation[:, 0] * [1.0, 1.0, 0.0]
    x, z = x / np.linalg.norm(x), np.array([0.0, 0.0, -1.0])
    return np.stack([x, np.cross(z, x), z], axis=1)


def _other(grasps: list[Grasp], attempt: int) -> Grasp:
    """A grasp away from the best one: further down the list, at another place or yaw."""
    best = grasps[0]
    away = (np.linalg.norm(grasp.position - best.position) > 0.02 for grasp in grasps)
    others = [one for one, far in zip(grasps, away, strict=True) if far or abs(one.yaw - best.yaw) > 0.5]
    return others[min(len(others) - 1, 10 * (attempt - 1))] if others else best


class LiberoExpert(Scripted):
    """A scripted controller for LIBERO's pick-and-place tasks, which reads the simulator's state.

    ``attempt``: index of the grasp with which it begins.
    """

    def __init__(self, action: ActionSpec = OWN, *, state: bool = False) -> None:
        super().__init__(PolicySpec("libero-expert", action=action, state=state, privileged=True))
        self.attempt, self._pace = 0, HZ // action.hz

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._acting.clear()  # a plan keeps its environment
        super().reset(episodes)

    def begin(self, start: EpisodeStart) -> Acting:
        plan = iter(tuple[Array, ...]())
        expert = task = None

        def act(seen: Observation) -> Array:
            """Give the next action in metres and radians, for ``pace`` control steps."""
            nonlocal plan, expert, task
            if not isinstance(seen.privileged, LiberoEnv):
                raise PolicyError("LIBERO's expert acts in LIBERO's worlds only", cause="protocol")
            expert = expert or Expert(seen.privileged, self.attempt, pace=self._pace)
            if seen.privileged.task is not task:  # it is about another thing from mid-episode on
                plan, task = expert.actions(), seen.privileged.task
            action = next(plan, None)
            metric = STAY.copy() if action is None else action * UNITS
            metric[:6] *= self._pace
            return metric

        return act


class LiberoDemonstrator(LiberoExpert):
    """Decides as often as a policy does, and writes actions as that does. See ``Demonstrator``."""

    tries = TRIES

    def __init__(self, interface: Interface) -> None:
        super().__init__(interface.spec.action, state=True)
        self._interface = interface
        self.written: list[Written] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset(episodes)
        self.written = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        written = [self._interface.written(chunk.actions[0]) for chunk in super().act(observations)]
        self.written += written
        return [ActionChunk(action[None].astype(np.float64)) for action in written]
