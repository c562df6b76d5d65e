"""Rigs: robots at their tables as data, with the nominal camera and lights.

The WidowX 250s and the Google robot, VLATest's two, need robot files from a pack. Sources: G, BE and PO are VLATest's
``grasp_single_in_scene_customizable.py``, ``base_env.py`` and ``put_on_in_scene_cutomizable.py``.
"""

import math
from dataclasses import dataclass, replace

from vlafuzz.errors import SceneError, suggestion
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
    """A box with its top at z = 0. ``half``: half sides; ``floor``: height of the floor below. Metres."""

    centre: tuple[float, float]
    half: tuple[float, float, float]
    floor: float


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


# The workspace is the operators' default ranges plus a margin. Reach and opening are from the Panda's data
# sheet (0.855 m to the wrist, 0.08 m), less what pointing down costs, measured with the inverse kinematics at
# table height.
PANDA = Rig(
    robot="panda",
    base=(-0.615, 0.0, 0.0),
    reach=0.79,
    opening=0.08,
    rest=(0.0, math.pi / 8, 0.0, -math.pi * 5 / 8, 0.0, math.pi * 3 / 4, math.pi / 4, 0.04, 0.04),
    workspace=Workspace(x=(-0.24, 0.16), y=(-0.30, 0.30)),
    view=View(eye=(0.42, 0.0, 0.52), target=(-0.04, 0.0, 0.02), fov=60.0),
    lights=Lights(ambient=0.18, directional=(((0.3, 0.4, -1.0), 0.72), ((-0.6, -0.5, -1.0), 0.31))),
    table=Table(centre=(-0.25, 0.0), half=(0.6, 0.7, 0.03), floor=-0.75),
)

# BE's lights in our frame: its robots look along -x, ours along x. As there, nothing casts shadows.
_LIGHTS = Lights(0.3, (((0.0, 0.0, -1.0), 2.2), ((1.0, 0.5, -1.0), 0.7), ((-1.0, -1.0, -1.0), 0.7)))

# Base, joints and table height: PO:245, BE:280-288. The camera is the one of ManiSkill's bridge agent, 0.16 m
# beside the base and 0.36 m above, f = 623.588 at 640 x 480; our principal point is centred, there it is half
# a pixel off. The hand is measured on the collision meshes, the reach with the inverse kinematics 0.1 m over
# the table.
_WIDOWX_REST = {
    "waist": -0.01840777,
    "shoulder": 0.0398835,
    "elbow": 0.22242722,
    "forearm_roll": -0.00460194,
    "wrist_angle": 1.36524296,
    "wrist_rotate": 0.00153398,
    "left_finger": 0.037,
    "right_finger": 0.037,
}
WIDOWX = Rig(
    robot="widowx",
    base=(-0.347, -0.05, 0.0),
    reach=0.46,
    opening=0.052,
    rest=tuple(_WIDOWX_REST.values()),
    joints=tuple(_WIDOWX_REST),
    workspace=Workspace(x=(-0.22, 0.14), y=(-0.20, 0.20)),
    surface=Workspace(x=(-0.27, 0.17), y=(-0.23, 0.23)),
    view=View(eye=(-0.347, -0.21, 0.36), target=(-0.01523, -0.02655, 0.0), fov=42.102, aspect=4 / 3),
    lights=_LIGHTS,
    table=Table(centre=(0.0, 0.0), half=(0.5, 0.45, 0.03), floor=-0.87),
    neutral=math.pi / 2,
    hand=Hand(
        widest=0.046,
        thinnest=0.014,
        lowest=0.018,
        highest=0.12,  # holding a bottle by its neck, the arm cannot lift straight up
        deep=0.020,
        lead=1.3,
        fingers=(0.0145, (0.026, 0.042), (-0.016, 0.04)),
        palm=(0.036, (0.0, 0.053), (0.022, 0.16)),
    ),
    physics_hz=500,
    seconds=24,  # the reference's 120 steps
    urdf="widowx/wx250s.urdf",
    operators="widowx",
)

# Base and joints: G:161-164, BE:265-276; the table is 0.87 m high, its box BE:180-201. The camera is in the
# head: link_camera at these joints, f = 425 at 640 x 512. The wrist's limit is 1.79 rad, so the hand leans
# outward with distance and height.
_GOOGLE_REST = {
    "joint_torso": -0.2639457174606611,
    "joint_shoulder": 0.0831913360274175,
    "joint_bicep": 0.5017611504652179,
    "joint_elbow": 1.156859026208673,
    "joint_forearm": 0.028583671314766423,
    "joint_wrist": 1.592598203487462,
    "joint_gripper": -1.080652960128774,
    "joint_finger_right": 0.0,
    "joint_finger_left": 0.0,
    "joint_head_pan": -0.00285961,
    "joint_head_tilt": 0.7851361,
}
GOOGLE = Rig(
    robot="google",
    base=(-0.60, 0.0, -0.79095),
    reach=0.82,
    opening=0.141,
    rest=tuple(_GOOGLE_REST.values()),
    joints=tuple(_GOOGLE_REST),
    workspace=Workspace(x=(-0.24, 0.08), y=(-0.26, 0.26)),
    surface=Workspace(x=(-0.26, 0.35), y=(-0.37, 0.37)),
    view=View(eye=(-0.45401, -0.00042, 0.42241), target=(-0.03131, -0.00163, 0.0), fov=62.126, aspect=1.25),
    lights=_LIGHTS,
    table=Table(centre=(0.045, 0.0), half=(0.315, 0.38, 0.03), floor=-0.87),
    neutral=math.radians(190),
    hand=Hand(
        lowest=0.010,
        # Fitted to the inverse kinematics, as the factors of ``lean`` are: straight down up to 0.64 m at the table and
        # 0.44 m a hand above; nowhere at 0.2 m over the table, where the lean is 0.35 rad at 0.56 m.
        straight=0.69,
        lead=1.5,
        fingers=(0.026, (0.060, 0.111), (-0.006, 0.08)),
        palm=(0.046, (0.0, 0.070), (0.038, 0.16)),
    ),
    physics_hz=513,
    control_hz=3,
    seconds=40,  # the reference's 120 steps of move-near
    urdf="googlerobot/google_robot_meta_sim_fix_wheel_fix_fingertip.urdf",
    operators="google",
)

RIGS = {rig.robot: rig for rig in (PANDA, WIDOWX, GOOGLE)}
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
    """The rig of a robot.

    Raises:
        SceneError: no such robot.
    """
    known = RIGS | OF_LIBERO | _OF_PHOTOS
    if robot not in known:
        raise SceneError(f"robot: unknown robot {robot!r}", hint=suggestion(robot, known))
    return known[robot]
