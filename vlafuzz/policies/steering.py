"""Steering: from where the hand is to where it should be, as metric actions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vlafuzz.rigs.rig import Rig

Array = NDArray[np.float64]
STEP = 0.10  # metres in a control step
TURN = 0.6  # radians in a control step
TILT = 0.1  # radians off


class Steering:
    """A hand that points down, as far as its arm lets it.

    Args:
        lean: of the hand, radians off the vertical: it comes from the robot's side; negative, from beyond.
    """

    def __init__(self, rig: Rig, lean: float) -> None:
        self._rig, self._lean = rig, lean

    def behind(self, place: Array, height: float) -> Array:
        """``(2,)`` from above a place to where a leaning hand is at that height on its line. Metres."""
        return np.asarray(-math.tan(self._lean) * height * self._outward(place))

    def toward(self, tcp: Array, rotation: Array, target: Array, yaw: float, gripper: float) -> Array:
        """``(7,)`` the action that brings a hand with its TCP at ``tcp`` nearer to ``target``."""
        way, lead = target - tcp, self._rig.hand.lead
        length = math.hypot(*way)
        way = way * (STEP / length if length * lead > STEP else lead)
        return np.array([*way, *(self._turn(tcp, rotation, yaw) * lead), gripper])

    def hand_yaw(self, tcp: Array, rotation: Array) -> float:
        """Direction of the closing axis, within a turn of the neutral one: the last joint cannot go round."""
        yaw = math.atan2(rotation[1, 1], rotation[0, 1])
        neutral = self._rig.neutral_yaw(*tcp[:2])
        return neutral + (yaw - neutral + np.pi) % (2 * np.pi) - np.pi

    def upright(self, tcp: Array, rotation: Array) -> bool:
        """Whether the hand points where it should: one whose lean depends on the place lags behind it."""
        return self._rig.hand.lean_model is None or math.hypot(*self._tilt(tcp, rotation)[:2]) < TILT

    def _turn(self, tcp: Array, rotation: Array, yaw: float) -> Array:
        """Rotation vector that points the hand down, but for its lean, its closing axis along ``yaw``."""
        x, y, z = self._tilt(tcp, rotation)
        return np.array([x, y, z + min(max(yaw - self.hand_yaw(tcp, rotation), -TURN), TURN)])

    def _tilt(self, tcp: Array, rotation: Array) -> Array:
        """``(3,)`` from where the hand points to where it should."""
        distance = math.dist(tcp[:2], self._rig.base[:2])
        lean = self._lean + self._rig.hand.lean(distance, float(tcp[2]))
        wanted = np.array([*(math.sin(lean) * self._outward(tcp)), -math.cos(lean)])
        return np.cross(rotation[:, 2], wanted)

    def _outward(self, place: Array) -> Array:
        """``(2,)`` from the robot to a place, of length 1."""
        way = place[:2] - np.asarray(self._rig.base[:2])
        return np.asarray(way / np.linalg.norm(way))
