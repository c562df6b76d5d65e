"""Actions as models write them, turned into moves along and turns about the axes of the robot's base."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def _two_columns(numbers: Array) -> Rotation:
    """The first two columns of the matrix, one after the other (Zhou et al., 2019), made orthonormal."""
    first = _unit(numbers[:, :3])
    second = _unit(numbers[:, 3:] - np.sum(first * numbers[:, 3:], axis=1, keepdims=True) * first)
    return Rotation.from_matrix(np.stack([first, second, np.cross(first, second)], axis=-1))


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (lengths > 1e-9).all():
        raise ValueError(
            "six numbers that are no rotation: two columns of a matrix are not parallel, nor zero"
        )
    return np.asarray(vectors / lengths)


def _interleaved(numbers: Array) -> Rotation:
    """The same columns row by row, as vla-eval's ``rot6d_interleaved``."""
    return _two_columns(numbers[:, [0, 2, 4, 1, 3, 5]])


# How a rotation is written: of how many numbers, and what they mean.
ROTATIONS: dict[str, tuple[int, Callable[[Array], Rotation]]] = {
    "axis_angle": (3, Rotation.from_rotvec),
    "rpy": (3, lambda numbers: Rotation.from_euler("xyz", numbers)),
    "euler_xyz": (3, lambda numbers: Rotation.from_euler("XYZ", numbers)),
    "quaternion_xyzw": (4, Rotation.from_quat),
    "quaternion_wxyz": (4, lambda numbers: Rotation.from_quat(np.roll(numbers, -1, axis=1))),
    "rot6d": (6, _two_columns),
    "rot6d_interleaved": (6, _interleaved),
}
SCALED = tuple(name for name, (width, _) in ROTATIONS.items() if width == 3)


@dataclass(frozen=True)
class Convention:
    """What the numbers of a model's action are: a position, a rotation, the gripper.

    Attributes:
        pose: they say where the hand is to be, in the frame of the proprioception; else how it is to move.
        tool: a move is along and about the hand's own axes.
        rotation: a name of ``ROTATIONS``.
        position_scale: metres a unit; ``rotation_scale``: radians a unit, for those of ``SCALED``.
    """

    pose: bool
    tool: bool
    rotation: str
    position_scale: float
    rotation_scale: float

    @property
    def plain(self) -> bool:
        """The harness understands it as it is."""
        return not self.measured and self.rotation in SCALED

    @property
    def measured(self) -> bool:
        """What an action means depends on where the hand is."""
        return self.pose or self.tool

    def moves(self, actions: Array, hand: Array) -> Array:
        """``(steps, n)`` as ``(steps, 7)``: metres, rotation vector, gripper.

        ``hand``: ``(6,)`` where it is now, position and rotation vector.

        Raises:
            ValueError: not so many numbers, not finite, or no rotation.
        """
        width, read = ROTATIONS[self.rotation]
        if actions.ndim != 2 or actions.shape[1] != 4 + width:
            raise ValueError(
                f"actions of shape {actions.shape}, expected (steps, {4 + width}) with {self.rotation}"
            )
        if not np.isfinite(actions).all():
            raise ValueError(f"an action is not finite: {actions[~np.isfinite(actions).all(axis=1)][0]}")
        shifts = actions[:, :3] * self.position_scale
        turns = read(actions[:, 3:-1] * (self.rotation_scale if width == 3 else 1.0))
        now = Rotation.from_rotvec(hand[3:6])
        if self.pose:
            shifts, turns = shifts - hand[:3], turns * now.inv()
        elif self.tool:
            shifts, turns = now.apply(shifts), now * turns * now.inv()
        return np.hstack([shifts, turns.as_rotvec(), actions[:, -1:]])
