"""Fewer triangles: edges collapse where that moves the surface least (Garland and Heckbert, 1998).

What remains are points of the mesh with their texture coordinates. Seams, where a point has several of these, and
borders stay as they are, so that none opens.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
CREASE = 40.0  # degrees between normals that stay apart
_LOSSLESS = np.sqrt(np.finfo(float).eps)  # by which a surface may move that fast-simplification calls the same


class Mesh(NamedTuple):
    """A mesh: points ``(n, 3)``, unit normals, texture coordinates ``(n, 2)``, and triangles ``(m, 3)`` of points."""

    points: Floats
    normals: Floats
    textures: Floats
    triangles: Ints


def collapsed(positions: Floats, normals: Floats, textures: Floats, tolerances: Sequence[float]) -> Iterator[Mesh]:
    """The same mesh with fewer triangles, for each of the tolerances.

    Args:
        positions, normals: ``(n, 3, 3)`` of each triangle's corners; ``textures``: ``(n, 3, 2)``, or zeros. tolerances:
        metres by which a point may be off the planes of the triangles that it replaces (root of the sum of squares).
    """
    corners = np.concatenate([positions, textures], axis=2).reshape(-1, 5)
    points, at = np.unique(corners, axis=0, return_inverse=True)
    for tolerance in tolerances:
        remaining = _remaining(points[:, :3], at.reshape(-1, 3), tolerance)[at]
        label = _smoothed(remaining, normals.reshape(-1, 3))
        first = np.unique(label, return_index=True)[1]
        sums = np.stack([np.bincount(label, part) for part in normals.reshape(-1, 3).T], axis=1)
        shades = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
        used, numbers = np.unique(label.reshape(-1, 3)[_solid(remaining.reshape(-1, 3))], return_inverse=True)
        places, flat = np.split(points[remaining[first[used]]], [3], axis=1)
        places, shades, flat = (part.astype(np.float32, order="C") for part in (places, shades[used], flat))
        yield Mesh(places, shades, flat, numbers.reshape(-1, 3).astype(np.uint32))


def _remaining(points: Floats, triangles: Ints, tolerance: float) -> Ints:
    """The point that remains for each: of those that collapse into one, the nearest to where that would be best."""
    from fast_simplification import simplify

    unit = tolerance / _LOSSLESS
    best, _, collapses = simplify(points / unit, triangles, lossless=True, preserve_border=True, return_collapses=True)
    into = np.arange(len(points))
    for kept, gone in collapses[::-1]:
        into[gone] = into[kept]
    goals = points.copy()
    goals[np.unique(into[triangles][_solid(into[triangles])])] = best * unit
    farthest_first = np.argsort(-np.linalg.norm(points - goals[into], axis=1), kind="stable")
    nearest = np.empty_like(into)
    nearest[into[farthest_first]] = farthest_first  # the last one stays
    return nearest[into]


def _smoothed(groups: Ints, normals: Floats) -> Ints:
    """Numbers of corners, from 0; those of a group share one if their normals are within ``CREASE``."""
    label, left, count = np.full(len(groups), -1), np.arange(len(groups)), 0
    while len(left):
        seeds, first, index = np.unique(groups[left], return_index=True, return_inverse=True)
        near = np.einsum("ni,ni->n", normals[left[first]][index], normals[left]) > np.cos(np.radians(CREASE))
        near[first] = True
        label[left[near]] = count + index[near]
        left, count = left[~near], count + len(seeds)
    return np.unique(label, return_inverse=True)[1].reshape(-1)


def _solid(triangles: Ints) -> NDArray[np.bool_]:
    return np.asarray((np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1))
