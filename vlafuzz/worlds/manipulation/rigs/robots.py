"""The available rigs, as data: the Panda, and VLATest's two robots, the WidowX 250s and the Google robot.

The last two need robot files from a pack. In the ``-photo`` variants, the third-person camera sees a photo behind robot
and objects, as in the reference. Sources: G, BE and PO are VLATest's ``grasp_single_in_scene_customizable.py``,
``base_env.py`` and ``put_on_in_scene_cutomizable.py``.
"""

import math
from dataclasses import replace

from vlafuzz.errors import SceneError, suggestion
from vlafuzz.worlds.manipulation.rigs.rig import Hand, LeanModel, Lights, Rig, Table, View, Workspace

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
        # Fitted to the inverse kinematics: straight down up to 0.64 m at the table and 0.44 m a hand above;
        # nowhere at 0.2 m over the table, where the lean is 0.35 rad at 0.56 m.
        lean_model=LeanModel(height_weight=2.5, straight_reach=0.69, slope=1.67),
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

_BRIDGE = "bridge_real_eval_1.png"
_CAN, _NEAR = "google_coke_can_real_eval_1.png", "google_move_near_real_eval_1.png"
_BY_TASK = {"pick-up": _CAN, "move-near": _NEAR, "put-on": _CAN, "put-in": _CAN}
_ALL = (
    PANDA,
    WIDOWX,
    replace(WIDOWX, robot="widowx-photo", photos=dict.fromkeys(_BY_TASK, _BRIDGE)),
    GOOGLE,
    replace(GOOGLE, robot="google-photo", photos=_BY_TASK),
)
RIGS = {rig.robot: rig for rig in _ALL}

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
    known = RIGS | OF_LIBERO
    if robot not in known:
        raise SceneError(f"robot: unknown robot {robot!r}", hint=suggestion(robot, known))
    return known[robot]
