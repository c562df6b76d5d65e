"""Where a robot's links are at the start of an episode, as convex bodies: what may hide an object.

``arms.json`` holds the joints and bodies; ``scripts/make_arms.py`` writes it.
"""

import json
from dataclasses import astuple
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.model.scene import InitialPose
from vlafuzz.worlds.manipulation.rigs.rig import Rig

Array = NDArray[np.float64]
_NOTHING = (0.0, 0.0, 0.0)


def bodies(rig: Rig, pose: InitialPose) -> tuple[Array, ...]:
    """``(k, 3)`` corners of the convex bodies of all links in the world, metres."""
    return _bodies(rig.robot.removesuffix("-photo"), rig.base, rig.rest, rig.arm_joints, pose)


@cache
def _links() -> dict[str, list[dict[str, Any]]]:
    links: dict[str, list[dict[str, Any]]] = json.loads(
        (files("vlafuzz.worlds.manipulation.rigs") / "arms.json").read_text()
    )
    return links


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
