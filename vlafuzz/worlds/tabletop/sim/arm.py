"""MetricArm: an end-effector controller in metres.

ManiSkill 3.0.1's ``pd_ee_delta_pose`` rotates the wrong way (its issue 1469) and clips; this one does neither.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import sapien
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array

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

    def __init__(
        self,
        robot: sapien.physx.PhysxArticulation,
        tcp_name: str,
        gripper: Gripper,
        *,
        pace: Pace | None = None,
        yields: bool = False,
    ) -> None:
        self._robot, self.gripper, self._yields = robot, gripper, yields
        self._tcp = next(i for i, link in enumerate(robot.links) if link.name.endswith(tcp_name))
        self._link = robot.links[self._tcp]
        self._model = robot.create_pinocchio_model()
        self._joints = robot.active_joints
        self._free = np.repeat([1, 0], [len(self._joints) - 2, 2])
        low, high = np.array(robot.qlimits[:-2], dtype=np.float64).T
        self._low, self._high = low - 1e-3, high + 1e-3
        self._profile = MotionProfile(pace, len(self._joints)) if pace else None

    def reset(self) -> None:
        self._qpos = np.array(self._robot.qpos, dtype=np.float64)
        self._model.compute_forward_kinematics(self._qpos)
        self.target = self._model.get_link_pose(self._tcp)
        if self._profile:
            self._profile.start(self._qpos)
        self._drive(self._qpos)

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
