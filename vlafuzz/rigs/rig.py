"""What a rig is: robot, table, nominal camera and lights as data, and the camera's geometry. No simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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

    def width(self, height: int) -> int:
        """Pixels of a picture of the whole view; a multiple of four where it is no square, for videos."""
        return height if self.aspect == 1 else 4 * round(height * self.aspect / 4)


@dataclass(frozen=True)
class Lights:
    """The nominal lights. ``directional``: (direction, intensity) each; all are white."""

    ambient: float
    directional: tuple[tuple[tuple[float, float, float], float], ...]


@dataclass(frozen=True)
class Table:
    """A box whose top is z = 0. ``half``: its half sides; ``floor``: height of what it stands on. Metres."""

    centre: tuple[float, float]
    half: tuple[float, float, float]
    floor: float


Box = tuple[float, tuple[float, float], tuple[float, float]]


LEAN_MOST = 0.55  # radians


@dataclass(frozen=True)
class Hand:
    """A gripper, as who plans grasps with it sees it. Metres, from the tool centre point (TCP).

    Grasps are made for the Panda's (``objects/grasps.py``); the other hands say what to change in them.

    Attributes:
        widest: thing that it takes between its fingers, which are 3 mm off on either side.
        thinnest: thing that it holds: fingers do not always close all the way.
        lowest: height of the TCP over the table at which the fingertips clear it.
        highest: place of a grasp over the table from which it can still lift and carry.
        deep: how far a thing may stick up between the fingers.
        stoops: of an arm that does not let it point straight down everywhere: what a metre of height counts,
            how many metres from the base it does, and by how many radians it leans outward a metre on.
        lead: how many times the way there is to go the hand is told, as it lags behind.
        fingers, palm: boxes of the open hand: half width across; span along the closing axis, on both sides;
            span of heights.
    """

    widest: float = 0.074
    thinnest: float = 0.0
    lowest: float = 0.0
    highest: float = math.inf
    deep: float = math.inf
    lean_model: tuple[float, float, float] | None = None
    lead: float = 1.0
    fingers: Box = (0.013, (0.038, 0.062), (-0.012, 0.05))
    palm: Box = (0.035, (0.0, 0.105), (0.038, 0.16))

    def lean(self, distance: float, height: float) -> float:
        """By how many radians it leans outward there, metres from the base and over the table."""
        if self.lean_model is None:
            return 0.0
        counts, straight, on = self.lean_model
        return min(max((distance + counts * height - straight) * on, 0.0), LEAN_MOST)

    def takes(self, width: float, height: float) -> bool:
        """Whether it can hold a thing that is so wide where it is grasped, so high over the table. Metres."""
        return self.thinnest <= width <= self.widest and height <= self.highest


@dataclass(frozen=True)
class Original:
    """Where robot and table stand in the environments that a rig is taken from. Metres, degrees."""

    base: tuple[float, float, float]
    yaw: float
    table: float


@dataclass(frozen=True)
class Rig:
    """A robot at its table. The table's top is z = 0; the robot's base frame is aligned with the world's.

    Attributes:
        base: of the robot, metres.
        reach: farthest horizontal distance from the base that the hand gets to, metres.
        opening: widest opening of the gripper, metres.
        rest: joint positions at the start of an episode, radians and metres.
        joints: the names of the joints of ``rest``; none where it is in the simulator's order.
        neutral: of ``neutral_yaw``, radians from the direction in which the hand is, seen from the base.
        physics_hz: physics steps a second.
        control_hz: control steps a second, where that is for its controller to say and not for the policy.
        seconds: after which a rollout ends.
        urdf: the robot's file below ``robots/`` in a user's pack; None for what comes with ManiSkill.
        surface: where things may stand all the same: of scenes that others made.
        photos: below ``overlays/`` in a user's pack, by task: what the third-person camera sees behind robot
            and objects. Only with its nominal view.
        operators: the ranges that fit, where the user names none.
    """

    robot: str
    base: tuple[float, float, float]
    reach: float
    opening: float
    rest: tuple[float, ...]
    workspace: Workspace
    view: View
    lights: Lights
    table: Table
    joints: tuple[str, ...] = ()
    neutral: float = -math.pi / 4
    hand: Hand = Hand()
    physics_hz: int = 100
    control_hz: int | None = None
    seconds: int = 16
    urdf: str | None = None
    surface: Workspace | None = None
    photos: Mapping[str, str] = field(default_factory=dict)
    operators: str = "tabletop"
    original: Original | None = None

    def neutral_yaw(self, x: float, y: float) -> float:
        """Direction of the closing axis, in radians, where the last joint is in the middle of its range.

        That is with the hand pointing down at (x, y), in metres.

        From there it turns by at least 2.4 rad (140 degrees) either way.
        """
        return math.atan2(y - self.base[1], x - self.base[0]) + self.neutral


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
