"""The robots as ManiSkill agents with a metric controller: the Panda, VLATest's WidowX 250s and Google robot.

The files of the last two are in the user's packs. Their gains, limits and friction are the reference's (SIMPLER's
``configs/{widowx,google_robot}/defaults.py``, tuned there to the real robots' motion). ManiSkill 3.0.1's
``pd_ee_delta_pose`` rotates the wrong way (its issue 1469) and clips; our controller does neither.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
from gymnasium import spaces
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.registration import register_agent
from mani_skill.agents.robots.panda import Panda
from scipy.spatial.transform import Rotation

from vlafuzz.common import assets
from vlafuzz.common.arrays import Array
from vlafuzz.worlds.manipulation.rigs import GOOGLE, PANDA, WIDOWX, Rig
from vlafuzz.worlds.tabletop.objects.packs import check_references

# Half a Newton step per iteration converges in a dozen iterations. SAPIEN's default of a tenth takes four
# times as long; whole steps overshoot near the joint limits and find 4 % fewer targets.
IK_STEP, IK_ITERATIONS = 0.5, 50
# For the search within the joint limits by damped least squares. A radian counts as 0.2 m.
NEAREST_ITERATIONS, DAMPING, FARTHEST_STEP = 20, 1e-4, 0.2
TWIST_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])


def shifted(pose: sapien.Pose, shift: Array, turn: Array) -> sapien.Pose:
    """A pose translated by ``(3,)`` metres and rotated in place by a ``(3,)`` rotation vector in radians."""
    x, y, z = turn.tolist()
    angle = math.hypot(x, y, z)
    sine = math.sin(angle / 2) / angle if angle > 1e-12 else 0.5
    by = sapien.Pose(q=[math.cos(angle / 2), x * sine, y * sine, z * sine])
    return sapien.Pose(pose.p + shift, (by * sapien.Pose(q=pose.q)).q)


def _damped(jacobian: Array, twist: Array) -> Array:
    return np.asarray(jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), twist))


@dataclass(frozen=True)
class Gripper:
    """Two fingers, the robot's last two joints."""

    closed: float  # joint positions for commands of -1 and +1, radians or metres
    open: float
    width: Callable[[Array], float]  # between them in metres, given all joint positions


@dataclass(frozen=True)
class Pace:
    """Limits on the motion of the drive targets of arm and fingers, in radians and seconds."""

    speed: float
    acceleration: float
    finger_speed: float
    finger_acceleration: float


class MetricArm:
    """Converts metric actions to joint targets by inverse kinematics, starting from the last targets.

    An action has seven numbers: dx, dy, dz in metres along the base's axes, a rotation vector in radians about these
    axes through the tool centre point, and the gripper in [-1, 1], 1 open. Nothing is clipped; deltas are added to the
    last *target*. With ``yields``, the hand approaches a target out of reach as far as it can, instead of staying.
    """

    def __init__(self, robot: sapien.physx.PhysxArticulation, agent: "type[_Metric]") -> None:
        self._robot, self.gripper, self._yields, pace = robot, agent.gripper, agent.yields, agent.pace
        self._tcp = next(i for i, link in enumerate(robot.links) if link.name.endswith(agent.tcp_name))
        self._link = robot.links[self._tcp]
        self._model = robot.create_pinocchio_model()
        self._joints = robot.active_joints
        self._free = np.repeat([1, 0], [len(self._joints) - 2, 2])
        low, high = np.array(robot.qlimits[:-2], dtype=np.float64).T
        self._low, self._high = low - 1e-3, high + 1e-3
        self._profile = MotionProfile(pace, len(self._joints)) if pace else None
        self._fingers = [(joint, joint.stiffness, joint.damping, joint.force_limit) for joint in self._joints[-2:]]

    def reset(self) -> None:
        self._qpos = np.array(self._robot.qpos, dtype=np.float64)
        self._model.compute_forward_kinematics(self._qpos)
        self.target = self._model.get_link_pose(self._tcp)
        if self._profile:
            self._profile.start(self._qpos)
        self._drive(self._qpos)

    def grip(self, force: float) -> None:
        """Let the fingers press with a share of their usual force."""
        for joint, stiffness, damping, limit in self._fingers:
            joint.set_drive_properties(force * stiffness, damping, force_limit=force * limit, mode="force")

    def command(self, action: Array, relative_to: str = "target") -> None:
        """Set the drive targets for one control step; the arm stays where one is out of reach."""
        if relative_to == "current":
            self.target = self._robot.root_pose.inv() * self._link.entity_pose
        target = shifted(self.target, action[:3], action[3:6])
        qpos, solved, _ = self._model.compute_inverse_kinematics(
            self._tcp,
            target,
            initial_qpos=self._qpos,
            active_qmask=self._free,
            max_iterations=IK_ITERATIONS,
            dt=IK_STEP,
        )
        solved = solved and bool(((self._low <= qpos[:-2]) & (qpos[:-2] <= self._high)).all())
        if not solved and self._yields:
            qpos, solved = self._nearest(target, self._qpos.copy()), True
            target = self._model.get_link_pose(self._tcp)
        if solved:
            self.target, self._qpos = target, qpos
        closed, opened = self.gripper.closed, self.gripper.open
        self._qpos[-2:] = closed + (opened - closed) * (min(max(action[6], -1.0), 1.0) + 1) / 2
        if self._profile is None:
            self._drive(self._qpos)

    def _nearest(self, target: sapien.Pose, qpos: Array) -> Array:
        """The joint positions within the limits nearest to a pose, searched from ``qpos``; position first."""
        low, high = self._low + 2e-3, self._high - 2e-3
        for _ in range(NEAREST_ITERATIONS):
            qpos[:-2] = np.clip(qpos[:-2], low, high)
            self._model.compute_forward_kinematics(qpos)
            off = self._model.get_link_pose(self._tcp).inv() * target
            twist = np.concatenate([off.p, Rotation.from_quat(off.q[[1, 2, 3, 0]]).as_rotvec()]) * TWIST_WEIGHTS
            if np.abs(twist).max() < 1e-4:
                break
            jacobian = self._model.compute_single_link_local_jacobian(qpos, self._tcp)[:, :-2]
            jacobian = jacobian * TWIST_WEIGHTS[:, None]
            step = _damped(jacobian, twist)
            stuck = ((qpos[:-2] <= low) & (step < 0)) | ((qpos[:-2] >= high) & (step > 0))
            step = _damped(np.where(stuck, 0.0, jacobian), twist)
            qpos[:-2] += step * min(1.0, FARTHEST_STEP / np.abs(step).max())
        qpos[:-2] = np.clip(qpos[:-2], low, high)
        return qpos

    def advance(self, seconds: float) -> None:
        """Move the drive targets for one physics step, if there is a pace."""
        if self._profile:
            self._drive(self._profile.step(self._qpos, seconds))

    def _drive(self, qpos: Array) -> None:
        for joint, target in zip(self._joints, qpos.tolist(), strict=True):
            joint.set_drive_target(target)


class MotionProfile:
    """Motion of joint positions to targets that may change at any time, with limited acceleration."""

    def __init__(self, pace: Pace, joints: int) -> None:
        arms = joints - 2
        self._speed = np.repeat([pace.speed, pace.finger_speed], [arms, 2])
        self._acceleration = np.repeat([pace.acceleration, pace.finger_acceleration], [arms, 2])

    def start(self, positions: Array) -> None:
        self._position, self._velocity = positions.copy(), np.zeros_like(positions)

    def step(self, targets: Array, seconds: float) -> Array:
        """Positions so many seconds later: as fast as allowed, braking in time."""
        error = targets - self._position
        braking = np.sqrt(2 * self._acceleration * np.abs(error))
        wanted = np.sign(error) * np.minimum(np.minimum(self._speed, braking), np.abs(error) / seconds)
        change = self._acceleration * seconds
        self._velocity += np.clip(wanted - self._velocity, -change, change)
        self._position = self._position + self._velocity * seconds
        return self._position


class _Metric(BaseAgent):
    """A robot that a ``MetricArm`` moves, in place of ManiSkill's controllers.

    Attributes:
        tcp_name: the link of the tool centre point.
        fingers: the links of each finger, first the one with the pad; its y axis is the closing axis. tool: from the
        TCP link's axes to the hand's, z along the fingers and y the closing axis. wrist: the link for a wrist camera;
        None if there is none. pace, yields: see ``MetricArm``.
    """

    rig: Rig
    tcp_name: str
    gripper: Gripper
    fingers: tuple[tuple[str, ...], ...]
    tool: sapien.Pose | None = None
    wrist: str | None = None
    pace: Pace | None = None
    yields = False

    action_space = single_action_space = spaces.Box(-np.inf, np.inf, (7,))

    def set_control_mode(self, control_mode: str | None = None) -> None:
        """Called by ManiSkill once the robot is loaded: sets the gains, joint by joint; no link sags."""
        for name, (stiffness, damping, force) in self.rig.gains.items():
            joint = self.robot.active_joints_map[name]
            joint.set_drive_properties(stiffness, damping, force_limit=force, mode="force")
            joint.set_friction(0.0)
        for link in self.robot.links:
            link.disable_gravity = True
        self.arm = MetricArm(self.robot._objs[0], type(self))

    @property
    def controller(self) -> MetricArm:
        return self.arm

    def get_controller_state(self) -> dict[str, Any]:
        return {}


@register_agent()
class MetricPanda(_Metric, Panda):
    """ManiSkill's Panda, whose visual meshes are simplified: ``scripts/make_panda.py``."""

    uid = "vlafuzz_panda"
    rig = PANDA
    urdf_path = str(assets.operators_dir() / "robots" / "panda" / "panda_v2.urdf")
    tcp_name = "panda_hand_tcp"
    fingers = (("panda_leftfinger",), ("panda_rightfinger",))
    wrist = "panda_hand"
    # Closed is below zero, so that the gripper also presses on thin objects.
    gripper = Gripper(closed=-0.01, open=0.04, width=lambda qpos: float(qpos[-1] + qpos[-2]))


class _FromPack(_Metric):
    """A robot whose files are in a pack.

    Its hand yields out of reach; the reference exceeds joint limits there, or does not move at all.
    """

    yields = True

    def _load_articulation(self, initial_pose: Any = None) -> None:
        name = f"robots/{self.rig.urdf}"
        urdf = assets.need(name, f"robot {self.rig.robot}")
        check_references(urdf, urdf.parents[name.count("/")])
        self.urdf_path = str(urdf)
        super()._load_articulation(initial_pose)


def _friction(**links: float) -> dict[str, Any]:
    """ManiSkill's ``urdf_config`` for the friction of links; the patch radius adds torsional friction."""
    materials = {
        f"of_{friction:g}": {"static_friction": friction, "dynamic_friction": friction, "restitution": 0.0}
        for friction in set(links.values())
    }
    patches = {
        name: {"material": f"of_{friction:g}", "patch_radius": 0.1, "min_patch_radius": 0.1}
        for name, friction in links.items()
    }
    return {"_materials": materials, "link": patches}


@register_agent()
class MetricWidowX(_FromPack):
    uid = "vlafuzz_widowx"
    rig = WIDOWX
    disable_self_collisions = True  # the hand's meshes overlap: in SAPIEN 3 the fingers would be stuck
    tcp_name = "ee_gripper_link"
    fingers = (("left_finger_link",), ("right_finger_link",))
    tool = sapien.Pose(q=[0.5**0.5, 0.0, 0.5**0.5, 0.0])  # x is along the fingers
    # As in the reference, a millimetre beyond the joint limits, for some force at either end. The gap between
    # the fingers' collision meshes is 22 mm less than the joint positions.
    gripper = Gripper(closed=0.014, open=0.038, width=lambda qpos: float(qpos[-1] + qpos[-2]) - 0.022)
    urdf_config = _friction(left_finger_link=2.0, right_finger_link=2.0)


# Gap between the Google robot's fingers in metres by joint position, measured on the collision meshes.
_JOINT, _WIDTH = (0.0, 0.3, 0.6, 0.9, 1.15), (0.141, 0.114, 0.081, 0.031, 0.0)


@register_agent()
class MetricGoogle(_FromPack):
    uid = "vlafuzz_google"
    rig = GOOGLE
    tcp_name = "link_gripper_tcp"
    fingers = tuple(
        (f"link_finger_tip_{side}", f"link_finger_{side}", f"link_finger_nail_{side}") for side in ("left", "right")
    )
    gripper = Gripper(  # closed is a hundredth beyond the limit
        closed=1.31, open=0.0, width=lambda qpos: float(np.interp((qpos[-1] + qpos[-2]) / 2, _JOINT, _WIDTH))
    )
    urdf_config = _friction(
        **dict.fromkeys((name for finger in fingers for name in finger[:2]), 2.0),
        **dict.fromkeys((finger[2] for finger in fingers), 0.1),
    )
    # The reference planner's limits without that of the jerk, 50 rad/s^3, which delays each change of
    # acceleration by 0.04 s.
    pace = Pace(speed=1.5, acceleration=2.0, finger_speed=1.0, finger_acceleration=7.0)


AGENTS: dict[str | None, type[BaseAgent]] = {None: MetricPanda, WIDOWX.urdf: MetricWidowX, GOOGLE.urdf: MetricGoogle}
