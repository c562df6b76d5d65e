"""The rig as data: robot, table, nominal camera and lights, and the camera's geometry. No simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.errors import SceneError, suggestion
from vlafuzz.scene import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Workspace:
    """The rectangle of the table's top (z = 0) in which objects may stand. Metres."""

    x: tuple[float, float]
    y: tuple[float, float]


@dataclass(frozen=True)
class View:
    """A pinhole camera. ``eye`` and ``target`` in metres, ``fov`` the vertical field of view in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float
    aspect: float = 1.0


@dataclass(frozen=True)
class Lights:
    """The nominal lights. ``directional``: (direction, intensity) each; all are white."""

    ambient: float
    directional: tuple[tuple[tuple[float, float, float], float], ...]


@dataclass(frozen=True)
class Rig:
    """A robot at its table. The table's top is z = 0; the robot's base frame is aligned with the world's.

    Attributes:
        base: of the robot, metres.
        reach: farthest horizontal distance from the base at which the hand still points straight down,
            metres.
        opening: widest opening of the gripper, metres.
        rest: joint positions at the start of an episode, radians and metres.
    """

    robot: str
    base: tuple[float, float, float]
    reach: float
    opening: float
    rest: tuple[float, ...]
    workspace: Workspace
    view: View
    lights: Lights

    def neutral_yaw(self, x: float, y: float) -> float:
        """Direction of the closing axis, in radians, where the last joint is in the middle of its range.

        That is with the hand pointing down at (x, y), in metres.

        From there it turns 2.9 rad (166 degrees) either way.
        """
        return math.atan2(y - self.base[1], x - self.base[0]) - math.pi / 4


# The workspace is a margin wider than the operators' default ranges; reach and opening are the Panda's
# (data sheet: 0.855 m
# to the wrist, 0.08 m opening), less what pointing down costs (measured with the inverse kinematics at
# table height).
PANDA = Rig(
    robot="panda",
    base=(-0.615, 0.0, 0.0),
    reach=0.79,
    opening=0.08,
    rest=(0.0, math.pi / 8, 0.0, -math.pi * 5 / 8, 0.0, math.pi * 3 / 4, math.pi / 4, 0.04, 0.04),
    workspace=Workspace(x=(-0.24, 0.16), y=(-0.30, 0.30)),
    view=View(eye=(0.42, 0.0, 0.52), target=(-0.04, 0.0, 0.02), fov=60.0),
    lights=Lights(ambient=0.18, directional=(((0.3, 0.4, -1.0), 0.72), ((-0.6, -0.5, -1.0), 0.31))),
)
RIGS = {PANDA.robot: PANDA}


def rig(robot: str) -> Rig:
    """The rig of a robot.

    Raises:
        SceneError: no such robot.
    """
    if robot not in RIGS:
        raise SceneError(f"robot: unknown robot {robot!r}", hint=suggestion(robot, RIGS))
    return RIGS[robot]


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where a camera stands: ``position`` (3,) in metres; ``axes`` (3, 3), its rows forward, left and up."""

    position: Array
    axes: Array
    fov: float
    aspect: float

    def project(self, points: Array) -> tuple[Array, Array]:
        """Image coordinates of world points.

        Args:
            points: ``(n, 3)`` metres.

        Returns:
            ``(n, 2)`` u to the right and v down, both in [0, 1] inside the picture; ``(n,)`` depth along
            the axis, metres.
        """
        forward, left, up = ((points - self.position) @ self.axes.T).T
        scale = 2 * math.tan(math.radians(self.fov) / 2) * np.maximum(forward, 1e-6)
        return np.stack([0.5 - left / (scale * self.aspect), 0.5 - up / scale], axis=1), forward

    def back_project(self, uv: Array, height: float) -> Array:
        """Where the rays through ``(n, 2)`` image points meet the plane z = ``height``: ``(n, 3)`` metres."""
        scale = 2 * math.tan(math.radians(self.fov) / 2)
        local = np.stack(
            [np.ones(len(uv)), (0.5 - uv[:, 0]) * scale * self.aspect, (0.5 - uv[:, 1]) * scale], axis=1
        )
        rays = local @ self.axes
        return np.asarray(self.position + rays * ((height - self.position[2]) / rays[:, 2])[:, None])

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Of the camera's frame (x forward, y left, z up), as w, x, y, z."""
        x, y, z, w = Rotation.from_matrix(self.axes.T).as_quat()
        return float(w), float(x), float(y), float(z)


_NOMINAL = Camera()


@lru_cache(maxsize=256)
def camera_pose(view: View, camera: Camera = _NOMINAL) -> CameraPose:
    """The nominal view, moved and turned as a scene's camera says.

    Roll, pitch and yaw turn it about its own forward, left and up axes, in the order yaw, pitch, roll.
    """
    eye = np.array(view.eye)
    forward = np.array(view.target) - eye
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    nominal = np.stack([forward, left, np.cross(forward, left)])
    turn = Rotation.from_euler("ZYX", [camera.yaw, camera.pitch, camera.roll], degrees=True).as_matrix()
    return CameraPose(eye + np.array(camera.offset), turn.T @ nominal, view.fov, view.aspect)
