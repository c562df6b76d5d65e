"""The space that objects of a scene occupy, and their outlines on the table. Metres."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.model import Placement
from vlafuzz.model.scene import Quaternion
from vlafuzz.worlds.manipulation.rotations import rotation_matrix
from vlafuzz.worlds.tabletop.objects.hulls import outline
from vlafuzz.worlds.tabletop.objects.model import ObjectModel


@dataclass(frozen=True, eq=False)
class Footprint:
    """A convex outline from above: ``polygon`` (k, 2), counter-clockwise, within ``radius`` of ``centre``."""

    centre: tuple[float, float]
    polygon: Array
    radius: float


def footprint(placement: Placement, model: ObjectModel) -> Footprint:
    """The outline of an object where it is placed."""
    polygon, radius = _outline(model, placement.rest, placement.quaternion)
    turned = (polygon * placement.scale) @ _turn(placement).T
    centre = _centre(placement, model)
    return Footprint(centre, turned + centre, radius * placement.scale)


def solid(placement: Placement, model: ObjectModel) -> Array:
    """``(m, 3)`` hull vertices of an object where it is placed."""
    scaled = model.scaled(placement.scale)
    turn, place = pose_of(placement, scaled)
    return np.asarray(scaled.vertices @ turn.T + place)


def pose_of(placement: Placement, model: ObjectModel) -> tuple[Array, Array]:
    """Rotation ``(3, 3)`` and position ``(3,)`` of an object, scaled already, where it is placed."""
    if placement.quaternion is not None:
        turn = model.turned(placement.quaternion)
        return turn, np.array([*_centre(placement, model), -float((model.vertices @ turn[2]).min())])
    pose = model.stable_pose(placement.rest)
    about = np.eye(3)
    about[:2, :2] = _turn(placement)
    return about @ rotation_matrix(pose.quaternion), np.array([placement.x, placement.y, pose.height])


def apart(a: Footprint, b: Footprint) -> bool:
    """Whether two outlines are disjoint, that is, an edge of one of them separates them."""
    if math.dist(a.centre, b.centre) > a.radius + b.radius:
        return True
    return _separates(a.polygon, b.polygon) or _separates(b.polygon, a.polygon)


def extents(polygon: Array) -> Array:
    """``(90, 2)`` extents along and across 90 directions, every 2 degrees."""
    along = polygon @ _AXES  # (k, 180): 45 columns on is across
    sides = along.max(axis=0) - along.min(axis=0)
    return np.asarray(np.stack([sides[:90], np.roll(sides, -45)[:90]], axis=1))


_ANGLES = np.radians(np.arange(0.0, 360.0, 2.0))
_AXES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


def _separates(a: Array, b: Array) -> bool:
    edges = np.roll(a, -1, axis=0) - a
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)  # outwards
    return bool(np.any((b @ normals.T).min(axis=0) >= (a * normals).sum(axis=1)))


def _centre(placement: Placement, model: ObjectModel) -> tuple[float, float]:
    if placement.quaternion is None:
        return placement.x, placement.y
    x, y, _ = model.shift(placement.quaternion) * placement.scale
    return placement.x + float(x), placement.y + float(y)


def _turn(placement: Placement) -> Array:
    if placement.quaternion is not None:
        return np.eye(2)
    angle = math.radians(placement.yaw)
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


@lru_cache(maxsize=512)
def _outline(model: ObjectModel, rest: str, quaternion: Quaternion | None) -> tuple[Array, float]:
    if quaternion:
        polygon = outline((model.vertices @ model.turned(quaternion).T)[:, :2])
    else:
        polygon = model.stable_pose(rest).footprint
    return polygon, float(np.linalg.norm(polygon, axis=1).max())
