"""Scenes, environments and trajectories that the simulator's tests share."""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.model import Camera, Conditions, Light, Outcome, Placement, Scene
from vlafuzz.model.scene import Newcomer, Slide
from vlafuzz.policies.base import CameraRequest, Policy
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator, TabletopEnv
from vlafuzz.worlds.tabletop.tasks import State, load_wordings, say

CATALOGUE = load_catalogue()
SIZE = 128  # of a picture, pixels
FRONT = CameraRequest("front", SIZE, SIZE)
NOT_MOVED = Camera()
STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])


def nominal(task: str = "pick-up") -> Scene:
    """A fair scene with the first suitable objects."""
    names = {"move-near": CATALOGUE.names("graspable")[:2], "put-on": (CATALOGUE.names("graspable")[0], "plate")}
    names |= {"pick-up": CATALOGUE.names("graspable")[:1], "put-in": (CATALOGUE.names("graspable")[0], "basket")}
    targets = tuple(put(name, *place) for name, place in zip(names[task], ((-0.05, 0.0), (-0.05, 0.2)), strict=False))
    return Scene(task, targets, say(load_wordings()[task][0], [CATALOGUE[name].spoken for name in names[task]]))


def put(name: str, x: float, y: float, yaw: float = 0.0, rest: str | None = None, **more: Any) -> Placement:
    return Placement(name, rest or CATALOGUE[name].stable_poses[0].name, x, y, yaw, **more)


def pick_up(target: Placement, *confounders: Placement, light: float = 1.0, camera: Camera = NOT_MOVED) -> Scene:
    instruction = f"pick up {CATALOGUE[target.object].spoken}"
    return Scene("pick-up", (target,), instruction, confounders=confounders, light=Light(light), camera=camera)


# Six objects around and under the hand at rest: tall, low and rolling ones, and one that the fingers hit.
CROWDED = replace(nominal(), confounders=(put("green_cube", 0.05, 0.2),))
EVENTFUL = replace(CROWDED, newcomer=Newcomer("approach", "first"), target_slide=Slide("approach", 0.05, 120.0))
CROWD = pick_up(
    put("coke_can", 0.0, 0.0, 20.0),
    put("orange", -0.05, 0.12),
    put("redbull_can", -0.05, -0.12, 65.0, "lying"),
    put("apple", 0.08, 0.10),
    put("eggplant", 0.08, -0.08, 130.0),
    put("sponge", -0.15, 0.0, 200.0, "on_edge"),
)


def random_scene(rng: np.random.Generator) -> Scene:
    """One to five objects anywhere, at times into each other."""
    names = rng.choice(CATALOGUE.names(), size=rng.integers(1, 6), replace=False)
    low, high = (-0.2, -0.25, -180), (0.12, 0.25, 180)  # x, y, yaw
    placed = [put(str(name), *rng.uniform(low, high).tolist()) for name in names]
    return pick_up(*placed, light=float(rng.uniform(0.5, 2)))


def pushes() -> list[np.ndarray]:
    """Down among the objects, then to and fro, with fingers that open and close: most of it in contact."""
    rng = np.random.default_rng(7)
    moves = rng.uniform(-1, 1, (14, 7)) * [0.02, 0.02, 0.01, 0.1, 0.1, 0.3, 1.0]
    moves[:3, 2] = -0.04
    moves[3:, 1] += np.repeat([0.07, -0.07, 0.07], [3, 5, 3])
    return list(moves)


def make_env(task: str = "pick-up", **more: Any) -> TabletopEnv:
    return TabletopEnv(task, CATALOGUE, **more)


def evaluator_of(policy: Policy, recording: Recording | None = None, **conditions: Any) -> ManiSkillEvaluator:
    """Of a policy, as a rule in the task pick-up."""
    under = Conditions(**{"task": "pick-up", "world": {"min_distance": 0.15}} | conditions)
    return ManiSkillEvaluator(under, policy, CATALOGUE, recording=recording)


def evaluate(policy: Policy, *scenes: Scene, recording: Recording | None = None, **conditions: Any) -> list[Outcome]:
    """The outcomes of a policy in scenes of one task."""
    with closing(evaluator_of(policy, recording, **{"task": scenes[0].task} | conditions)) as evaluator:
        return evaluator.evaluate(scenes)


def play(env: TabletopEnv, actions: Iterable[Any], still: int = 0, relative_to: str = "target") -> State:
    """The state after some actions and steps without a command."""
    for action in actions:
        state = env.advance(np.asarray(action, dtype=np.float64), relative_to)
    rest = np.array([0.0] * 6 + [action[6]])
    for _ in range(still):
        state = env.advance(rest)
    return state


def states_hash(env: TabletopEnv, scene: Scene = CROWD) -> str:
    """Of the trajectory that ``pushes`` makes in a scene."""
    env.begin(scene)
    play(env, pushes())
    return env.world.states_hash.hexdigest()


def turn(start: State, end: State) -> np.ndarray:
    """``(3,)`` rotation vector of the hand from one state to another, in the base's axes."""
    return Rotation.from_matrix(end.tcp_rotation @ start.tcp_rotation.T).as_rotvec()
