"""Convex hulls: corners, triangles, volumes and sections. Lengths in metres."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from vlafuzz.common.arrays import Array

Faces = NDArray[np.int64]


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
