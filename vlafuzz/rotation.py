"""Rotation matrices from quaternions for inner loops, without the overhead of SciPy's ``Rotation``."""

from __future__ import annotations

from collections.abc import Iterable


def matrix(quaternion: Iterable[float]) -> list[list[float]]:
    """The 3 × 3 rotation matrix of a unit quaternion w, x, y, z, in double precision."""
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
