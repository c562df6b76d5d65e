"""Detects an object's cavity from above: whether other objects can be put into it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from vlafuzz.objects.hulls import Array
from vlafuzz.objects.model import Container

STEP = 0.004  # of the height grid, metres
UNEVEN = 0.008  # how far the floor may rise towards the walls, metres
SMALLEST = 0.05  # side of a cavity, metres
WALL = 0.02  # least height of the rim above the floor, metres


def find_cavity(parts: Sequence[Array]) -> Container | None:
    """The largest cavity about the origin with an even floor and walls all round; None if it is too small.

    Args:
        parts: convex parts ``(n, 3)``, z up.
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
    if rim - floor < WALL:
        return None
    half = _grown(surface <= floor + UNEVEN, middle)
    width, depth = (round(2 * count * STEP, 4) for count in half)
    if min(width, depth) < SMALLEST:
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
