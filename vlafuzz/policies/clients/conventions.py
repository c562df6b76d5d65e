"""How models write poses: conventions of actions, and layouts of proprioception by vla-eval's names."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.policies.base import Observation

Array = NDArray[np.float64]
State = NDArray[np.float32]


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (lengths > 1e-9).all():
        raise ValueError("six numbers that are no rotation: two columns of a matrix are not parallel, nor zero")
    return np.asarray(vectors / lengths)


def _two_columns(numbers: Array) -> Rotation:
    """From the first two columns of the matrix (Zhou et al., 2019), which are made orthonormal."""
    first = _unit(numbers[:, :3])
    second = _unit(numbers[:, 3:] - np.sum(first * numbers[:, 3:], axis=1, keepdims=True) * first)
    return Rotation.from_matrix(np.stack([first, second, np.cross(first, second)], axis=-1))


# A hand that points down is half a turn about x away from the base. Its angle would jump between 180 and -180
# degrees with the last bit, and nobody learns from such numbers, so it goes on to 270, as robosuite's do.


def _vectors(turns: Rotation) -> Array:
    """``(n, 3)`` rotation vectors; beyond 90 degrees those with x from 0 on."""
    vectors, angles = turns.as_rotvec(), turns.magnitude()
    other = (angles > np.pi / 2) & (vectors[:, 0] < 0)
    vectors[other] *= 1 - 2 * np.pi / angles[other, None]
    return np.asarray(vectors)


def _quaternions(turns: Rotation) -> Array:
    """``(n, 4)`` x, y, z, w with w from 0 on; beyond 90 degrees those with x from 0 on."""
    numbers = turns.as_quat(canonical=True)
    numbers[(turns.magnitude() > np.pi / 2) & (numbers[:, 0] < 0)] *= -1
    return np.asarray(numbers)


class Numbers(NamedTuple):
    """A rotation as numbers: how they are called, read and written."""

    names: tuple[str, ...]
    read: Callable[[Array], Rotation]
    write: Callable[[Rotation], Array]


def _euler(axes: str, *names: str) -> Numbers:
    def angles(turns: Rotation) -> Array:
        """``(n, 3)`` Euler angles, the first one from -90 to 270 degrees."""
        written = turns.as_euler(axes)
        written[written[:, 0] < -np.pi / 2, 0] += 2 * np.pi
        return np.asarray(written)

    return Numbers(names, lambda n: Rotation.from_euler(axes, n), angles)


PLACE, TURN, SIX = ("x", "y", "z"), ("rx", "ry", "rz"), ("r0", "r1", "r2", "r3", "r4", "r5")
ROTATIONS = {
    "axis_angle": Numbers(TURN, Rotation.from_rotvec, _vectors),
    "rpy": _euler("xyz", "roll", "pitch", "yaw"),
    "euler_xyz": _euler("XYZ", "ex", "ey", "ez"),
    "quaternion_xyzw": Numbers(("qx", "qy", "qz", "qw"), Rotation.from_quat, _quaternions),
    "quaternion_wxyz": Numbers(
        ("qw", "qx", "qy", "qz"),
        lambda n: Rotation.from_quat(np.roll(n, -1, axis=1)),
        lambda turns: np.roll(_quaternions(turns), 1, axis=1),
    ),
    "rot6d": Numbers(SIX, _two_columns, lambda turns: turns.as_matrix()[:, :, :2].transpose(0, 2, 1).reshape(-1, 6)),
    "rot6d_interleaved": Numbers(  # in row-major order
        SIX, lambda n: _two_columns(n[:, [0, 2, 4, 1, 3, 5]]), lambda turns: turns.as_matrix()[:, :, :2].reshape(-1, 6)
    ),
}
SCALED = tuple(name for name, numbers in ROTATIONS.items() if len(numbers.names) == 3)


@dataclass(frozen=True)
class Convention:
    """What the numbers of a model's action mean: a position, a rotation and the gripper.

    Attributes:
        pose: the action is a target pose in the frame of the proprioception, instead of a delta.
        tool: deltas are in the hand's frame, instead of the robot's base.
        rotation: a name of ``ROTATIONS``.
        position_scale: metres per unit; ``rotation_scale``: radians per unit, only for ``SCALED``.
    """

    pose: bool
    tool: bool
    rotation: str
    position_scale: float
    rotation_scale: float

    @property
    def plain(self) -> bool:
        """Whether an ``ActionSpec`` can express it."""
        return not self.measured and self.rotation in SCALED

    @property
    def measured(self) -> bool:
        """Whether the meaning of an action depends on the hand's current pose."""
        return self.pose or self.tool

    def moves(self, actions: Array, hand: Array) -> Array:
        """Convert ``(steps, n)`` to ``(steps, 7)``: metres, rotation vector, gripper.

        ``hand``: ``(6,)`` its current position and rotation vector.

        Raises:
            ValueError: wrong number of values, not finite, or not a rotation.
        """
        names, read, _ = ROTATIONS[self.rotation]
        if actions.ndim != 2 or actions.shape[1] != 4 + len(names):
            expected = f"(steps, {4 + len(names)}) with {self.rotation}"
            raise ValueError(f"actions of shape {actions.shape}, expected {expected}")
        if not np.isfinite(actions).all():
            raise ValueError(f"an action is not finite: {actions[~np.isfinite(actions).all(axis=1)][0]}")
        shifts = actions[:, :3] * self.position_scale
        turns = read(actions[:, 3:-1] * (self.rotation_scale if self.rotation in SCALED else 1.0))
        now = Rotation.from_rotvec(hand[3:6])
        if self.pose:
            shifts, turns = shifts - hand[:3], turns * now.inv()
        elif self.tool:
            shifts, turns = now.apply(shifts), now * turns * now.inv()
        return np.hstack([shifts, turns.as_rotvec(), actions[:, -1:]])

    def written(self, moves: Array, hand: Array) -> Array:
        """The inverse of ``moves``: ``(steps, 7)`` in metres and rotation vectors to ``(steps, n)``."""
        now = Rotation.from_rotvec(hand[3:6])
        shifts, turns = moves[:, :3], Rotation.from_rotvec(moves[:, 3:6])
        if self.pose:
            shifts, turns = shifts + hand[:3], turns * now
        elif self.tool:
            shifts, turns = now.apply(shifts, inverse=True), now.inv() * turns * now
        numbers = ROTATIONS[self.rotation].write(turns)
        if self.rotation in SCALED:
            numbers = numbers / self.rotation_scale
        return np.hstack([shifts / self.position_scale, numbers, moves[:, -1:]])


def _two_fingers(state: State) -> State:
    """As robosuite has it, fingers in metres."""
    finger = state[6] * 0.04
    (turn,) = _vectors(Rotation.from_rotvec(state[None, 3:6]))
    return np.concatenate([state[:3], turn, [finger, -finger]], dtype=np.float32)


def _quaternion(state: State) -> State:
    """As SimplerEnv has it: w x y z, opening in [0, 1]."""
    ((x, y, z, w),) = _quaternions(Rotation.from_rotvec(state[None, 3:6]))
    return np.concatenate([state[:3], [w, x, y, z], state[6:]], dtype=np.float32)


def _from_down(state: State) -> State:
    """Angles relative to a hand that points down; the fingers are alike, so the smaller turn counts."""
    now = Rotation.from_rotvec(state[3:6])
    down = Rotation.from_rotvec(np.pi * np.eye(3)[:2])  # half turns about x and about y, each its own inverse
    turn = min((now * half for half in down), key=lambda turned: float(turned.magnitude()))
    return np.concatenate([state[:3], turn.as_euler("xyz"), [0.0], state[6:]], dtype=np.float32)


OWN = "eef_pos3_axisangle3_gripper1"  # as in ``PolicySpec.state``
MEASURED = "eef_pos3_axisangle3_gripper2"  # with both fingers, where a world measures them
# How our seven numbers are sent.
LAYOUTS: dict[str, Callable[[State], State]] = {
    OWN: lambda state: state,
    MEASURED: _two_fingers,
    "eef_pos3_quat4_gripper1": _quaternion,
    "eef_pos3_rpy3_pad1_gripper1": _from_down,
}
STATES = {  # what the numbers are called; opening: 1 for wide open
    OWN: (*PLACE, *TURN, "opening"),
    MEASURED: (*PLACE, *TURN, "left", "right"),
    "eef_pos3_quat4_gripper1": (*PLACE, "qw", "qx", "qy", "qz", "opening"),
    "eef_pos3_rpy3_pad1_gripper1": (*PLACE, "roll", "pitch", "yaw", "pad", "opening"),
}


def sent(layout: str, seen: Observation) -> State:
    """The state of an observation in a layout; where a world measures both fingers, all of it as measured."""
    assert seen.state is not None, "the spec asks for it"
    if layout == MEASURED and seen.fingers is not None:
        return np.concatenate([seen.state[:6], seen.fingers])
    return LAYOUTS[layout](seen.state)
