"""Rotations as matrices and as quaternions w, x, y, z."""

from collections.abc import Iterable

import numpy as np

from vlafuzz.common.arrays import Array


def rotation(start: Array, end: Array) -> Array:
    """The smallest rotation ``(3, 3)`` from one unit vector to another; about x or z if they are opposite."""
    cosine = float(start @ end)
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0]) if abs(start[0]) < 0.5 else np.diag([-1.0, -1.0, 1.0])
    axis = np.cross(start, end)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))


def rotation_matrix(quaternion: Iterable[float]) -> list[list[float]]:
    """The 3 × 3 rotation matrix of a unit quaternion w, x, y, z; in inner loops faster than SciPy."""
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


def quaternion(turn: Array) -> Array:
    """``(4,)`` w, x, y, z of a rotation ``(3, 3)``, rounded to 9 digits."""
    # Not by SciPy, whose last digit differs for some poses: built objects must not depend on its version
    w = np.sqrt(max(0.0, 1 + np.trace(turn))) / 2
    if w < 1e-6:
        axis = np.sqrt(np.maximum(0.0, (np.diag(turn) + 1) / 2))  # half a turn: about x, y or z
        return np.array([0.0, *axis])
    lower = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.asarray(np.round([w, *(lower / (4 * w))], 9) + 0.0)
