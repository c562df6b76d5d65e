"""Rigs: robots at their tables, with the nominal camera and lights; ``rigs.yaml`` holds their numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic import TypeAdapter

from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError, SceneError, suggestion
from vlafuzz.worlds.base import Robot


@dataclass(frozen=True)
class Workspace:
    """The rectangle of the table top (z = 0) in which objects may stand, metres."""

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
        """The width in pixels of an image of the whole view; a multiple of four unless square, for videos."""
        return height if self.aspect == 1 else 4 * round(height * self.aspect / 4)


@dataclass(frozen=True)
class Lights:
    """The nominal lights, all white. ``directional``: pairs (direction, intensity)."""

    ambient: float
    directional: tuple[tuple[tuple[float, float, float], float], ...]


@dataclass(frozen=True)
class Table:
    """A box with its top at z = 0. ``half``: half sides. There is a ``floor`` at z, and a ``wall`` at x. Metres."""

    centre: tuple[float, float]
    half: tuple[float, float, float]
    floor: float
    wall: float


Box = tuple[float, tuple[float, float], tuple[float, float]]

MAX_LEAN = 0.55  # radians


@dataclass(frozen=True, kw_only=True)
class Hand:
    """A gripper as grasp planning sees it. Metres, relative to the tool centre point (TCP).

    Grasps are computed for the Panda's gripper (``objects/grasps.py``); these limits adapt them to others.

    Attributes:
        widest: the widest object that fits between the fingers with 3 mm clearance on either side. thinnest: the
        thinnest object that the gripper holds; not all fingers close completely. lowest: height of the TCP over the
        table at which the fingertips clear it.
        highest: height of a grasp over the table up to which the arm can still lift and carry. deep: how far an object
        may stick up between the fingers.
        straight: effective distance from the base, horizontal plus 2.5 times the height, up to which the arm can point
            the hand straight down. lead: factor on commanded displacements, to compensate for the hand lagging behind.
        fingers, palm: boxes of the open hand: half width across; span along the closing axis, on both sides; span of
            heights.
    """

    widest: float = 0.074
    thinnest: float = 0.0
    lowest: float = 0.0
    highest: float = math.inf
    deep: float = math.inf
    straight: float = math.inf
    lead: float = 1.0
    fingers: Box = (0.013, (0.038, 0.062), (-0.012, 0.05))
    palm: Box = (0.035, (0.0, 0.105), (0.038, 0.16))

    def lean(self, distance: float, height: float) -> float:
        """The hand's outward lean, radians, at a distance from the base and a height over the table, metres."""
        return min(max((distance + 2.5 * height - self.straight) * 1.67, 0.0), MAX_LEAN)

    def takes(self, width: float, height: float) -> bool:
        """Whether the hand is capable of a grasp of this width and height over the table, metres."""
        return self.thinnest <= width <= self.widest and height <= self.highest


@dataclass(frozen=True, kw_only=True)
class Rig(Robot):
    """A robot at its table. The table top is z = 0; the robot's base frame is aligned with the world's.

    Attributes:
        base: position of the robot's base, metres.
        reach: largest horizontal distance from the base that the hand reaches, metres.
        opening: width of the fully open gripper, metres.
        rest: joint positions at the start of an episode, radians and metres.
        joints: joint names in the order of ``rest``; empty if ``rest`` is in the simulator's order. neutral:
        ``neutral_yaw`` relative to the direction from the base to the hand, radians. physics_hz: physics steps per
        second.
        control_hz: control steps per second if the robot's controller fixes them; None to follow the policy. seconds:
        length of a rollout.
        urdf: the robot's file below ``robots/`` in a pack; None for robots that come with ManiSkill. surface: the
        larger area in which imported scenes may place objects; None if it is the workspace.
        operators: name of the operator set that is used by default.
        initial_states: that a task has of its own; 0 where the operators say how it begins.
        gains: of the joints, arm first: stiffness, damping and force limit.
    """

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
    urdf: str | None = None
    surface: Workspace | None = None
    operators: str = "tabletop"
    initial_states: int = 0
    gains: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    @property
    def arm_joints(self) -> int:
        """The number of joints from the base to the hand, the first ones of ``rest``."""
        fingers = (index for index, name in enumerate(self.joints) if "finger" in name)
        return next(fingers, len(self.rest) - 2)

    def neutral_yaw(self, x: float, y: float) -> float:
        """The closing axis' yaw, radians, at which the last joint is in the middle of its range.

        The hand points down at (x, y), metres. From there the joint can turn by at least 2.4 rad either way.
        """
        return math.atan2(y - self.base[1], x - self.base[0]) + self.neutral


_FILE, _RIG = Path(__file__).with_name("rigs.yaml"), TypeAdapter(Rig)
RIGS = {
    name: validated(_RIG, {"robot": name, **fields}, _FILE, CatalogueError)
    for name, fields in read_yaml(_FILE, CatalogueError).items()
}
PANDA, WIDOWX, GOOGLE = RIGS["panda"], RIGS["widowx"], RIGS["google"]
# Stored scenes have them: a photo was behind them. No scene of theirs is fair any more.
_OF_PHOTOS = {"widowx-photo": WIDOWX, "google-photo": GOOGLE}

# LIBERO's Panda. Places are offsets from a suite's own initial state; base, joints and view are robosuite's,
# and nothing reads the Panda's here.
LIBERO = replace(
    PANDA,
    robot="libero",
    workspace=Workspace(x=(-0.2, 0.2), y=(-0.2, 0.2)),
    seconds=26,  # of the longest suite
    operators="libero",
    initial_states=50,
)
FORMER = ("libero-coarse", "libero-fast")  # stored scenes have them: their pictures were cheaper
OF_LIBERO = {name: replace(LIBERO, robot=name) for name in ("libero", *FORMER)}


def rig(robot: str) -> Rig:
    """The rig of a robot; a SceneError if there is none."""
    known = RIGS | OF_LIBERO | _OF_PHOTOS
    if robot not in known:
        raise SceneError(f"robot: unknown robot {robot!r}", hint=suggestion(robot, known))
    return known[robot]
