"""Layouts of proprioception, by vla-eval's names: how our seven numbers are sent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float32]


def _two_fingers(state: Array) -> Array:
    finger = state[6] * 0.04
    return np.concatenate([state[:6], [finger, -finger]], dtype=np.float32)


def _quaternion(state: Array) -> Array:
    x, y, z, w = Rotation.from_rotvec(state[3:6]).as_quat(canonical=True)
    return np.concatenate([state[:3], [w, x, y, z], state[6:]], dtype=np.float32)


OWN = "eef_pos3_axisangle3_gripper1"  # as in ``SubjectSpec.state``
# vla-eval's names, as its LIBERO (fingers in metres) and SimplerEnv (quaternion w x y z, opening in [0, 1])
# send them.
LAYOUTS: dict[str, Callable[[Array], Array]] = {
    OWN: lambda state: state,
    "eef_pos3_axisangle3_gripper2": _two_fingers,
    "eef_pos3_quat4_gripper1": _quaternion,
}
