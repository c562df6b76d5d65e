"""Where a robot's links are at the start of an episode, and its hand later on, as convex bodies.

``arms.json`` holds the links' joints and bodies; ``scripts/make_arms.py`` writes it.
"""

import json
from dataclasses import astuple
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.model import InitialPose
from vlafuzz.worlds.manipulation.rigs import Rig

_NOTHING = (0.0, 0.0, 0.0)
# Palm and fingers in the frame of the tool centre point, as outlines show them: z points down, metres.
_PALM = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.10, 0.10) for z in (-0.13, -0.045)])
_FINGERS = [
    np.array([[x, s * y, z] for x in (-0.01, 0.01) for y in (0.0, 0.022) for z in (-0.05, 0.008)]) for s in (1, -1)
]


def bodies(rig: Rig, pose: InitialPose) -> tuple[Array, ...]:
    """``(k, 3)`` corners of the convex bodies of all links in the world, metres."""
    return _bodies(rig.robot, rig.base, rig.rest, rig.arm_joints, pose)


@cache
def _links() -> Any:
    return json.loads((files("vlafuzz.worlds.manipulation") / "arms.json").read_text())


@lru_cache(maxsize=64)
def _bodies(
    robot: str, base: tuple[float, ...], rest: tuple[float, ...], arm_joints: int, pose: InitialPose
) -> tuple[Array, ...]:
    joints = np.array(rest)
    joints[:arm_joints] += np.radians(astuple(pose)[:arm_joints])
    turns, places, shown = list[Array](), list[Array](), list[Array]()
    for link in _links()[robot]:
        turn = Rotation.from_euler("xyz", link.get("rpy", _NOTHING)).as_matrix()
        place = np.array(link.get("xyz", _NOTHING), dtype=np.float64)
        if "slide" in link:
            place = place + turn @ np.array(link["slide"]) * joints[link["joint"]]
        if "turn" in link:
            turn = turn @ Rotation.from_rotvec(np.array(link["turn"]) * joints[link["joint"]]).as_matrix()
        if link["parent"] is None:
            place = place + base
        else:
            above = turns[link["parent"]]
            place, turn = places[link["parent"]] + above @ place, above @ turn
        turns.append(turn)
        places.append(place)
        shown += [np.array(body) @ turn.T + place for body in link.get("bodies", ())]
    return tuple(shown)


def hand_boxes(tcp: Array, rotation: Array, opening: float) -> list[Array]:
    """``(8, 3)`` corners of each box in the world, metres. ``opening``: gap between the fingers."""
    half = opening / 2
    fingers = [box + np.array([0.0, np.sign(box[:, 1].sum()) * half, 0.0]) for box in _FINGERS]
    return [box @ rotation.T + tcp for box in (_PALM, *fingers)]
