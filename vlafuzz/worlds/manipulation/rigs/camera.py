"""A camera's pose in a scene, and its projection."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.model.scene import Camera
from vlafuzz.worlds.manipulation.rigs.rig import View

Array = NDArray[np.float64]
_NOMINAL = Camera()


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
        w, x, y, z = Rotation.from_matrix(self.axes.T).as_quat(scalar_first=True).tolist()
        return w, x, y, z


@lru_cache(maxsize=256)
def camera_pose(view: View, camera: Camera = _NOMINAL) -> CameraPose:
    """The pose of the nominal view displaced by a scene's camera offset and rotation.

    Roll, pitch and yaw rotate it about its own forward, left and up axes, in the order yaw, pitch, roll.
    """
    eye = np.array(view.eye)
    forward = np.array(view.target) - eye
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    nominal = np.stack([forward, left, np.cross(forward, left)])
    turn = Rotation.from_euler("ZYX", [camera.yaw, camera.pitch, camera.roll], degrees=True).as_matrix()
    return CameraPose(eye + np.array(camera.offset), turn.T @ nominal, view.fov, view.aspect)
