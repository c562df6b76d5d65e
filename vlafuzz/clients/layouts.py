"""Layouts of proprioception, by vla-eval's names: how our seven numbers are sent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float32]
Layout = Callable[[Array], Array]


def _two_fingers(state: Array) -> Array:
    finger = state[6] * 0.04
    return np.concatenate([state[:6], [finger, -finger]], dtype=np.float32)


def _quaternion(state: Array) -> Array:
    x, y, z, w = Rotation.from_rotvec(state[3:6]).as_quat(canonical=True)
    return np.concatenate([state[:3], [w, x, y, z], state[6:]], dtype=np.float32)


def _bridge(state: Array) -> Array:
    """Angles from a hand that points down; the fingers are alike, so of two ways to turn it the shorter."""
    now = Rotation.from_rotvec(state[3:6])
    turn = min((now * down for down in DOWN), key=lambda turned: float(turned.magnitude()))
    return np.concatenate([state[:3], turn.as_euler("xyz"), [0.0], state[6:]], dtype=np.float32)


def width(layout: str) -> int:
    """How many numbers a layout has."""
    return len(LAYOUTS[layout](np.zeros(7, dtype=np.float32)))


DOWN = Rotation.from_rotvec(np.pi * np.eye(3)[:2])  # half turns about x and about y, their own inverses
OWN = "eef_pos3_axisangle3_gripper1"  # as in ``PolicySpec.state``
# vla-eval's names, as its LIBERO (fingers in metres) and SimplerEnv (quaternion w x y z, opening in [0, 1])
# send them; and GR00T's for the WidowX, whose angles are zero for a hand that points down.
LAYOUTS: dict[str, Callable[[Array], Array]] = {
    OWN: lambda state: state,
    "eef_pos3_axisangle3_gripper2": _two_fingers,
    "eef_pos3_quat4_gripper1": _quaternion,
    "eef_pos3_rpy3_pad1_gripper1": _bridge,
}
