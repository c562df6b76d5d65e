"""Geometric planning: which grasp to take, how high to travel, where to put an object down."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.manipulation.rigs import Hand, Rig
from vlafuzz.worlds.manipulation.rotations import rotation_matrix
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

UPRIGHT = np.cos(np.radians(8.0))  # the grasps of a stable pose remain valid up to this tilt
MARGIN = 0.006  # metres around fingers and hand
HIDING = 0.25  # metres of detour accepted so as not to put a right in front of b
GAP = 0.03  # metres between a and b after move-near, which accepts up to 0.05
_ANGLES = np.arange(0.0, 2 * np.pi, np.pi / 16)
_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])  # (2, 32) candidate separating axes
TRAVEL = 0.03  # metres of clearance between the fingertips or load and the objects below


@dataclass(frozen=True, eq=False)
class Thing:
    """An object at its believed pose: ``position`` (3,) of its origin, metres, and ``rotation`` (3, 3)."""

    model: ObjectModel
    position: Array
    rotation: Array

    @cached_property
    def corners(self) -> Array:
        """``(m, 3)`` vertices of the convex hull in world coordinates."""
        return np.asarray(self.model.vertices @ self.rotation.T + self.position)

    @cached_property
    def top(self) -> float:
        """The height of the highest point, metres."""
        return float(self.corners[:, 2].max())


@dataclass(frozen=True, kw_only=True)
class Reach:
    """A grasp: position of the TCP, direction of the closing axis, opening width. Metres and radians."""

    x: float
    y: float
    z: float
    yaw: float
    width: float
    cost: float


def reaches(thing: Thing, others: Sequence[Thing], hand_yaw: float, rig: Rig) -> list[Reach]:
    """All grasps of an object in its pose, best first: good contact, free of obstacles, little turning."""
    grasps = []
    for yaw, width, offset, z, quality in _grasps(thing):
        if not rig.hand.takes(width, z):
            continue
        x, y = thing.position[:2] + offset
        z = max(z, rig.hand.lowest, thing.top - rig.hand.deep)
        yaw = nearest_yaw(yaw, rig.neutral_yaw(x, y))
        turn = yaw - hand_yaw
        cost = 1.0 - quality + 2.0 * _crowding(np.array([x, y, z]), yaw, others, rig.hand) + 0.2 * abs(turn)
        grasps.append(Reach(x=float(x), y=float(y), z=float(z), yaw=yaw, width=width, cost=cost))
    return sorted(grasps, key=lambda reach: reach.cost)


def nearest_yaw(yaw: float, to: float) -> float:
    """The direction, equal to ``yaw`` up to half turns, that is nearest to ``to``. Radians."""
    return to + (yaw - to + np.pi / 2) % np.pi - np.pi / 2


def _grasps(thing: Thing) -> list[tuple[float, float, Array, float, float]]:
    """List the grasps of an object in its pose: (yaw, width, offset (2,) from the origin, z, quality)."""
    bottom = float(thing.corners[:, 2].min())
    for pose in thing.model.stable_poses:
        nominal = np.array(rotation_matrix(pose.quaternion))
        if thing.rotation[2] @ nominal[2] > UPRIGHT and pose.grasps:  # the vertical in the object's frame
            level = thing.rotation @ nominal.T
            grasps, yaw = pose.grasps, float(np.arctan2(level[1, 0], level[0, 0]))
            break
    else:
        shift = np.array([0.0, 0.0, thing.position[2] - bottom])
        grasps, yaw = find_grasps([part @ thing.rotation.T + shift for part in thing.model.parts], shift), 0.0
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return [
        (float(np.radians(g.yaw)) + yaw, g.width, turn @ np.array([g.x, g.y]), bottom + g.z, g.quality) for g in grasps
    ]


def _crowding(tcp: Array, yaw: float, others: Sequence[Thing], hand: Hand) -> float:
    """Count collisions between the gripper's boxes and other objects' bounding boxes."""
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    frame = np.stack([across, along, [0.0, 0.0, 1.0]])
    cuts = 0
    for other in others:
        local = (other.corners - tcp) @ frame.T
        low, high = local.min(axis=0) - MARGIN, local.max(axis=0) + MARGIN
        for half, (near, far), (below, above) in (hand.fingers, hand.palm):
            if high[0] < -half or low[0] > half or high[2] < below or low[2] > above:
                continue
            cuts += bool(high[1] > near and low[1] < far) or bool(low[1] < -near and high[1] > -far)
    return float(cuts)


def travel_height(start: Array, end: Array, others: Sequence[Thing], radius: float) -> float:
    """Height, metres, that clears all objects near the path from ``start`` to ``end`` ``(2,)``; 0 if none."""
    path = start + np.linspace(0.0, 1.0, 2 + int(np.linalg.norm(end - start) / 0.02))[:, None] * (end - start)
    along, highest = path @ _DIRECTIONS, 0.0
    for other in others:
        apart = (other.corners[:, :2] @ _DIRECTIONS).min(axis=0) - along  # (points, directions)
        if apart.max(axis=1).min() < radius:
            highest = max(highest, other.top + TRAVEL)
    return highest


@dataclass(frozen=True, eq=False)
class Goal:
    """A place to put a down, metres and radians."""

    place: Array  # (2,) of its origin
    turn: float  # on the way there, up to half a turn
    floor: float  # height of the surface below


def goal_on(a: Thing, b: Thing) -> Goal:
    return Goal(b.position[:2].copy(), 0.0, b.top)


def goal_in(a: Thing, b: Thing) -> Goal:
    """The goal in the centre of b, with the long sides of a and b aligned."""
    container = b.model.container
    if container is None:  # a policy that takes the wrong object for b still needs a goal
        return goal_on(a, b)
    along_y = 0.0 if container.width >= container.depth else np.pi / 2
    long_side = np.arctan2(b.rotation[1, 0], b.rotation[0, 0]) + along_y
    axis, elongation = _long_axis(a)
    turn = nearest_yaw(long_side, axis) - axis if elongation > 1.15 else 0.0
    return Goal(b.position[:2].copy(), float(turn), float(b.position[2] + container.floor))


def _long_axis(thing: Thing) -> tuple[float, float]:
    """Direction of the longest axis seen from above, radians, and its length relative to the other one."""
    points = thing.corners[:, :2]
    values, vectors = np.linalg.eigh(np.cov((points - (points.max(axis=0) + points.min(axis=0)) / 2).T))
    return float(np.arctan2(vectors[1, -1], vectors[0, -1])), np.sqrt(values[-1] / max(values[0], 1e-9))


def goal_near(a: Thing, b: Thing, others: Sequence[Thing], closing: float, rig: Rig, *, in_view: bool = False) -> Goal:
    """The goal near b: the nearest free place with the right gap to b and without the fingers between the two.

    ``in_view``: prefer places that are not between b and the camera.
    """
    angles = np.arange(0.0, 2 * np.pi, np.pi / 12)
    away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    outline = a.corners[:, :2] - a.position[:2]
    places = b.position[:2] + _distances(_clearance(outline, b), b.position[:2], away)[:, None] * away
    costs = np.linalg.norm(places - a.position[:2], axis=1) + 0.15 * np.abs(np.cos(angles - closing))
    costs += _unreachable(places, rig)
    if in_view:
        to_camera = np.array(rig.view.eye[:2]) - b.position[:2]
        costs += HIDING * np.maximum(away @ (to_camera / np.linalg.norm(to_camera)), 0.0)
    for other in others:
        apart = (_clearance(outline, other) - places @ _DIRECTIONS).max(axis=1)
        costs += np.where(apart > 0.05, 0.0, 1.0 + 10 * (0.05 - apart))
    return Goal(places[costs.argmin()], 0.0, 0.0)


def _clearance(outline: Array, other: Thing) -> Array:
    """``(32,)`` gap between an outline at (0, 0) and an object along each axis; the largest is the gap."""
    return np.asarray((other.corners[:, :2] @ _DIRECTIONS).min(axis=0) - (outline @ _DIRECTIONS).max(axis=0))


def _distances(clearance: Array, centre: Array, away: Array) -> Array:
    """``(n,)`` distances from b's centre that give the right gap, along unit vectors ``away`` ``(n, 2)``."""
    needed = GAP - (clearance - centre @ _DIRECTIONS)
    growth = -away @ _DIRECTIONS  # of the clearance per metre of distance
    reached = np.divide(needed, growth, out=np.full_like(growth, np.inf), where=growth > 1e-9)
    return np.asarray(reached.min(axis=1))


def _unreachable(places: Array, rig: Rig) -> Array:
    x, y = places.T
    (low_x, high_x), (low_y, high_y) = rig.workspace.x, rig.workspace.y
    outside = (x < low_x) | (x > high_x) | (y < low_y) | (y > high_y)
    far = np.hypot(x - rig.base[0], y - rig.base[1]) > rig.reach - 0.02
    return np.asarray(3.0 * outside + 3.0 * far)
