"""Layouts of proprioception by vla-eval's names, and what the numbers of states and actions are called."""

from collections.abc import Callable

import numpy as np
import scipy  # whose parts are loaded when they are used: every command would wait for them
from numpy.typing import NDArray

from vlafuzz.policies.base import Observation

State = NDArray[np.float32]
PLACE, TURN = ("x", "y", "z"), ("rx", "ry", "rz")
ROTATIONS = {"axis_angle": TURN, "rpy": ("roll", "pitch", "yaw"), "euler_xyz": ("ex", "ey", "ez")}

# A hand that points down is half a turn about x away from the base. Its angle would jump between 180 and -180
# degrees with the last bit, and nobody learns from such numbers, so beyond 90 degrees x goes on from 0 to 270.


def _two_fingers(state: State) -> State:
    """A rotation vector of up to 270 degrees, and both fingers in metres."""
    finger = state[6] * 0.04
    turn = scipy.spatial.transform.Rotation.from_rotvec(state[3:6])
    vector, angle = turn.as_rotvec(), turn.magnitude()
    if angle > np.pi / 2 and vector[0] < 0:
        vector *= 1 - 2 * np.pi / angle
    return np.concatenate([state[:3], vector, [finger, -finger]], dtype=np.float32)


def _quaternion(state: State) -> State:
    """The state in SimplerEnv's layout: a quaternion w x y z, the opening in [0, 1]."""
    turn = scipy.spatial.transform.Rotation.from_rotvec(state[3:6])
    x, y, z, w = turn.as_quat(canonical=True) * (-1 if turn.magnitude() > np.pi / 2 and state[3] < 0 else 1)
    return np.concatenate([state[:3], [w, x, y, z], state[6:]], dtype=np.float32)


def _from_down(state: State) -> State:
    """Angles relative to a hand that points down; the fingers are alike, so the smaller turn counts."""
    now = scipy.spatial.transform.Rotation.from_rotvec(state[3:6])
    halves = scipy.spatial.transform.Rotation.from_rotvec(np.pi * np.eye(3)[:2])  # about x, about y: their own inverses
    turn = min((now * half for half in halves), key=lambda turned: float(turned.magnitude()))
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
