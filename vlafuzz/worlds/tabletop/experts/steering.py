"""Steering: metric actions that bring the hand from its current pose towards a target."""

import math

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.manipulation.rigs.rig import Rig

Array = NDArray[np.float64]
STEP = 0.10  # metres in a control step
TURN = 0.6  # radians in a control step
TILT = 0.1  # radians: the largest tilt error of a hand that counts as upright


class Steering:
    """Keeps the hand pointing down, ``lean`` radians off the vertical; positive leans towards the robot."""

    def __init__(self, rig: Rig, lean: float) -> None:
        self._rig, self._lean = rig, lean

    def behind(self, place: Array, height: float) -> Array:
        """``(2,)`` horizontal offset, metres, of a leaning hand ``height`` metres above ``place``."""
        return np.asarray(-math.tan(self._lean) * height * self._outward(place))

    def toward(self, tcp: Array, rotation: Array, target: Array, yaw: float, gripper: float) -> Array:
        """``(7,)`` the action that moves the TCP from ``tcp`` towards ``target``."""
        shift, lead = target - tcp, self._rig.hand.lead
        length = math.hypot(*shift)
        shift = shift * (STEP / length if length * lead > STEP else lead)
        return np.array([*shift, *(self._turn(tcp, rotation, yaw) * lead), gripper])

    def hand_yaw(self, tcp: Array, rotation: Array) -> float:
        """Direction of the closing axis, within half a turn of the neutral one: the last joint has limits."""
        yaw = math.atan2(rotation[1, 1], rotation[0, 1])
        neutral = self._rig.neutral_yaw(*tcp[:2])
        return neutral + (yaw - neutral + np.pi) % (2 * np.pi) - np.pi

    def upright(self, tcp: Array, rotation: Array) -> bool:
        """Whether the hand has its intended tilt; with a lean model, the tilt lags behind while it moves."""
        return self._rig.hand.lean_model is None or math.hypot(*self._tilt(tcp, rotation)[:2]) < TILT

    def _turn(self, tcp: Array, rotation: Array, yaw: float) -> Array:
        """Rotation vector that restores the intended tilt and turns the closing axis towards ``yaw``."""
        x, y, z = self._tilt(tcp, rotation)
        return np.array([x, y, z + min(max(yaw - self.hand_yaw(tcp, rotation), -TURN), TURN)])

    def _tilt(self, tcp: Array, rotation: Array) -> Array:
        """``(3,)`` rotation vector from the hand's direction to the intended one."""
        distance = math.dist(tcp[:2], self._rig.base[:2])
        lean = self._lean + self._rig.hand.lean(distance, float(tcp[2]))
        wanted = np.array([*(math.sin(lean) * self._outward(tcp)), -math.cos(lean)])
        return np.cross(rotation[:, 2], wanted)

    def _outward(self, place: Array) -> Array:
        """``(2,)`` unit vector from the robot to a place."""
        shift = place[:2] - np.asarray(self._rig.base[:2])
        return np.asarray(shift / np.linalg.norm(shift))
