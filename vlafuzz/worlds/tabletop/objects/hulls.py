"""Convex hulls: corners, triangles, volumes, sections, and the cavity between several. Lengths in metres."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from vlafuzz.worlds.tabletop.objects.model import Container

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
STEP = 0.004  # of the height grid
RISING = 0.008  # how far the floor may rise towards the walls
NARROWEST = 0.05  # side of a cavity
RIM = 0.02  # least height of the rim above the floor


def corners(points: Array) -> Array:
    """The corners ``(m, 3)`` of the hull of points ``(n, 3)``, sorted and rounded to a micrometre."""
    rounded = np.round(points, 6) + 0.0  # + 0.0 replaces -0.0, which prints differently
    kept = rounded[ConvexHull(rounded).vertices]
    return np.unique(kept, axis=0)


def triangles(points: Array) -> Faces:
    """The triangles ``(k, 3)`` of the hull of points ``(n, 3)``, oriented outwards.

    Flat faces are cut into fans from their first corner, and everything is sorted, so that the result is independent of
    Qhull's version.
    """
    hull = ConvexHull(points)
    faces: set[tuple[int, int, int]] = set()
    for normal in np.unique(hull.equations[:, :3], axis=0):
        flat = np.unique(hull.simplices[np.all(hull.equations[:, :3] == normal, axis=1)])
        ring = [int(i) for i in flat[_around(points[flat], normal)]]
        first = ring.index(min(ring))
        ring = ring[first:] + ring[:first]
        faces.update((ring[0], a, b) for a, b in pairwise(ring[1:]))
    return np.array(sorted(faces), dtype=np.int64)


def _around(points: Array, normal: Array) -> NDArray[np.int64]:
    """The counter-clockwise order of points ``(n, 3)`` in a plane, seen from the tip of ``normal``."""
    arm = points - points.mean(axis=0)
    x = arm[0] / np.linalg.norm(arm[0])
    return np.argsort(np.arctan2(arm @ np.cross(normal, x), arm @ x))


def mass_properties(points: Array) -> tuple[float, Array]:
    """Volume in cubic metres and centroid ``(3,)`` of the hull of ``(n, 3)`` points."""
    middle = points.mean(axis=0)
    a, b, c = np.moveaxis((points - middle)[triangles(points)], 1, 0)
    cells = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    volume = float(cells.sum())
    return volume, middle + (cells[:, None] * (a + b + c) / 4).sum(axis=0) / volume


def outline(points: Array) -> Array:
    """The convex outline ``(k, 2)`` of ``(n, 2)`` points, counter-clockwise."""
    return np.asarray(points[ConvexHull(points).vertices], dtype=np.float64)


def section(points: Array, edges: Faces, z: float) -> Array:
    """Points ``(k, 2)``, corners included, on the section at height ``z`` of a convex body.

    ``points``: its corners ``(n, 3)``; ``edges``: ``(m, 2)`` pairs of corners.
    """
    low, high = points[edges[:, 0]], points[edges[:, 1]]
    crossing = (low[:, 2] - z) * (high[:, 2] - z) < 0
    low, high = low[crossing], high[crossing]
    share = (z - low[:, 2]) / (high[:, 2] - low[:, 2])
    return low[:, :2] + share[:, None] * (high - low)[:, :2]


def find_cavity(parts: Sequence[Array]) -> Container | None:
    """The largest cavity about the origin of convex parts ``(n, 3)``, z up; None if it is too small.

    It has an even floor and walls all round.
    """
    reach = np.abs(np.concatenate(parts)[:, :2]).max(axis=0)
    x, y = (np.arange(-np.floor(side / STEP), np.floor(side / STEP) + 1) * STEP for side in reach)
    surface = _heights(parts, x, y)
    middle = (len(x) // 2, len(y) // 2)
    floor = float(surface[middle])
    if not np.isfinite(floor):
        return None
    across, along = surface[:, middle[1]], surface[middle[0]]
    directions = (across[: middle[0]], across[middle[0] :], along[: middle[1]], along[middle[1] :])
    rim = float(min(heights.max(initial=-np.inf) for heights in directions))
    if rim - floor < RIM:
        return None
    half = _grown(surface <= floor + RISING, middle)
    width, depth = (round(2 * count * STEP, 4) for count in half)
    if min(width, depth) < NARROWEST:
        return None
    return Container(width, depth, round(floor, 4), round(rim, 4))


def _heights(parts: Sequence[Array], x: Array, y: Array) -> Array:
    """Height ``(len(x), len(y))`` of the top surface at each grid point; -inf beside the object."""
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    highest = np.full(len(places), -np.inf)
    for part in parts:
        planes = np.unique(np.round(ConvexHull(part).equations, 9), axis=0)
        slope = planes[:, 2]
        level = places @ planes[:, :2].T + planes[:, 3]  # of each plane, at z = 0
        upper, lower = slope > 1e-6, slope < -1e-6
        top = (-level[:, upper] / slope[upper]).min(axis=1)
        bottom = (-level[:, lower] / slope[lower]).max(axis=1)
        covers = (top >= bottom) & np.all(level[:, ~upper & ~lower] <= 0, axis=1)
        highest = np.where(covers, np.maximum(highest, top), highest)
    return np.asarray(highest.reshape(len(x), len(y)))


def _grown(free: NDArray[np.bool_], middle: tuple[int, int]) -> tuple[int, int]:
    """Half sides, in steps, of a rectangle that is grown about the middle while all of it is free."""
    half = [0, 0]
    growing = [True, True]
    while any(growing):
        for axis in (0, 1):
            wider = [size + (axis == i) for i, size in enumerate(half)]
            low, high = middle[0] - wider[0], middle[0] + wider[0] + 1
            near, far = middle[1] - wider[1], middle[1] + wider[1] + 1
            fits = low >= 0 and near >= 0 and high <= free.shape[0] and far <= free.shape[1]
            growing[axis] = growing[axis] and fits and bool(free[low:high, near:far].all())
            half[axis] += growing[axis]
    return half[0], half[1]
