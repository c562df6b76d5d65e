"""Solids: convex parts as physics simulates them, and the poses in which they stay put."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.manipulation.rotations import quaternion, rotation
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.hulls import corners, mass_properties, outline, triangles
from vlafuzz.worlds.tabletop.objects.model import Grasp, StablePose

UNEVEN = 5e-4  # metres; distance up to which a corner counts as in a face's plane
FIRM = 0.0015  # metres; least distance of the centre of mass from the face's edges: PhysX makes solids a little thinner
TIPS = np.radians(3.0)  # least tilt that a stable pose tolerates
ROLLS = np.radians(12.0)  # an object that tips at a smaller tilt rolls, if the adjacent face is near
NEXT = np.radians([5.0, 45.0])  # angle between adjacent faces
UP = np.array([0.0, 0.0, 1.0])


class Solid(NamedTuple):
    """An object as physics simulates it, in its own frame. Metres."""

    parts: tuple[Array, ...]  # (n, 3) corners of each convex part
    hull: Array  # (m, 3) corners of the convex hull of all parts
    volume: float  # summed over the parts
    balance: Array  # (3,) centre of mass


def solid(parts: Sequence[Array]) -> Solid:
    """The solid whose parts are the convex hulls of ``(n, 3)`` points each."""
    exact = tuple(corners(part) for part in parts)
    volumes, middles = zip(*map(mass_properties, exact), strict=True)
    balance = np.average(middles, axis=0, weights=volumes)
    return Solid(exact, corners(np.concatenate(exact)), float(sum(volumes)), balance)


class Stable(NamedTuple):
    """A rotation ``(3, 3)`` of a solid onto a stable face."""

    turn: Array
    up: float  # cosine between the solid's z axis and the vertical
    tilt: float  # at which it tips over, radians
    rolls: bool  # whether it tips easily, and onto an adjacent face


def stable_turns(body: Solid) -> list[Stable]:
    """All stable poses of a solid, on any face of its hull, even if it is not quite flat."""
    stable = []
    for face in normals(body.hull):
        turn, margin = lying(body, face, UNEVEN)
        tilt = float(np.arctan2(margin, (body.hull @ face).max() - body.balance @ face))
        if margin > FIRM and tilt > TIPS:
            stable.append((face, turn, tilt))
    faces = np.array([face for face, _, _ in stable])
    near, far = np.cos(NEXT)
    poses = []
    for face, turn, tilt in stable:
        cosines = faces @ face
        rolls = tilt < ROLLS and np.any((cosines < near) & (cosines > far))
        poses.append(Stable(turn, float(turn[2, 2]), tilt, bool(rolls)))
    return poses


def lying(body: Solid, face: Array, flat: float) -> tuple[Array, float]:
    """The rotation that turns a face down, and how far the centre of mass is inside the face's edges."""
    reach = body.hull @ face
    ground = body.hull[reach > reach.max() - flat]
    turn = rotation(face, -UP)
    polygon = outline((ground @ turn.T)[:, :2])
    side, arm = np.roll(polygon, -1, axis=0) - polygon, (turn @ body.balance)[:2] - polygon
    inside = (side[:, 0] * arm[:, 1] - side[:, 1] * arm[:, 0]) / np.linalg.norm(side, axis=1)
    return turn, float(inside.min())


def normals(hull: Array) -> Array:
    """Outward normals ``(k, 3)`` of the hull's triangles."""
    faces = hull[triangles(hull)]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def stable_pose(name: str, turn: Array, body: Solid, *, rolls: bool, graspable: bool) -> StablePose:
    """The stable pose of a solid after a rotation ``(3, 3)``, with grasps if it is ``graspable``."""
    height = float(np.round(-(body.hull @ turn.T)[:, 2].min(), 6))
    lift = np.array([0.0, 0.0, height])
    hull = np.round(body.hull @ turn.T + lift, 6) + 0.0
    grasps: tuple[Grasp, ...] = ()
    if graspable:
        grasps = find_grasps([part @ turn.T + lift for part in body.parts], turn @ body.balance + lift)
    return StablePose(
        name=name,
        quaternion=quaternion(turn),
        height=height,
        top=float(hull[:, 2].max()),
        footprint=outline(hull[:, :2]),
        rolls=rolls,
        grasps=grasps,
    )


def write_parts(parts: Sequence[Array], folder: Path) -> tuple[Path, ...]:
    files = tuple(folder / f"part_{number:02d}.obj" for number in range(len(parts)))
    for file, points in zip(files, parts, strict=True):
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles(points)]
        file.write_text("\n".join(lines) + "\n")
    return files
