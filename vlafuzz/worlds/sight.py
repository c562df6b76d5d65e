"""Sight: says what is where in a moment of a rollout, and where a camera shows it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vlafuzz.common.arrays import Array


@dataclass(frozen=True, eq=False)
class CameraPose:
    """A camera in the world: ``position`` (3,) in metres; ``axes`` (3, 3) with rows forward, left and up."""

    position: Array
    axes: Array
    fov: float
    aspect: float

    def project(self, points: Array) -> tuple[Array, Array]:
        """Image coordinates of world points ``(n, 3)``, and their depths ``(n,)`` along the axis; metres.

        Coordinates ``(n, 2)`` are u to the right and v down, both in [0, 1] inside the picture.
        """
        forward, left, up = ((points - self.position) @ self.axes.T).T
        scale = 2 * math.tan(math.radians(self.fov) / 2) * np.maximum(forward, 1e-6)
        return np.stack([0.5 - left / (scale * self.aspect), 0.5 - up / scale], axis=1), forward

    def back_project(self, uv: Array, height: float) -> Array:
        """Where the rays through ``(n, 2)`` image points hit the plane z = ``height``: ``(n, 3)`` metres."""
        scale = 2 * math.tan(math.radians(self.fov) / 2)
        local = np.stack([np.ones(len(uv)), (0.5 - uv[:, 0]) * scale * self.aspect, (0.5 - uv[:, 1]) * scale], axis=1)
        rays = local @ self.axes
        return np.asarray(self.position + rays * ((height - self.position[2]) / rays[:, 2])[:, None])

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The orientation of the camera frame (x forward, y left, z up) as w, x, y, z."""
        from scipy.spatial.transform import Rotation

        w, x, y, z = Rotation.from_matrix(self.axes.T).as_quat(scalar_first=True).tolist()
        return w, x, y, z


@dataclass(frozen=True, eq=False)
class Sight:
    """Says what is where at present, in the world; metres.

    ``camera`` is that of films, ``hand`` ``(3,)`` is between the fingers; ``bodies`` are places ``(3,)`` and turns
    ``(3, 3)`` by name; ``contacts`` say what touches what, as far as the world tells.
    """

    camera: CameraPose
    hand: Array
    bodies: Mapping[str, tuple[Array, Array]]
    contacts: frozenset[str] = frozenset()
