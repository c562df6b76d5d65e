"""Our own end-effector controller, in metres, and the Panda with it.

ManiSkill 3.0.1's ``pd_ee_delta_pose`` turns the wrong way (issue 1469) and clips; this one does neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium import spaces
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig
from mani_skill.agents.registration import register_agent
from mani_skill.agents.robots.panda import Panda
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.sim.maniskill.meshes import light_robot

Array = NDArray[np.float64]
CONTROL_MODE = "metric_ee"
# Half a Newton step an iteration converges in a dozen. SAPIEN's default of a tenth takes four times as long,
# and a whole one overshoots near the joints' limits (4 % fewer targets are found there).
IK_STEP, IK_ITERATIONS = 0.5, 50
# Of the search within the joints' limits: damped least squares; a radian off counts as 0.2 m.
NEAREST_ITERATIONS, DAMPING, FARTHEST_STEP = 20, 1e-4, 0.2
TWIST_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])


def shifted(pose: sapien.Pose, shift: Array, turn: Array) -> sapien.Pose:
    """A pose moved by ``(3,)`` metres and turned in place by a ``(3,)`` rotation vector in radians."""
    x, y, z = turn.tolist()
    angle = math.hypot(x, y, z)
    sine = math.sin(angle / 2) / angle if angle > 1e-12 else 0.5
    by = sapien.Pose(q=[math.cos(angle / 2), x * sine, y * sine, z * sine])
    return sapien.Pose(pose.p + shift, (by * sapien.Pose(q=pose.q)).q)


def _damped(jacobian: Array, twist: Array) -> Array:
    """The joints' step for a twist, by damped least squares."""
    return np.asarray(jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), twist))


@dataclass(frozen=True)
class Gripper:
    """Two fingers, the robot's last two joints.

    Attributes:
        closed, open: their positions for a command of -1 and +1, radians or metres.
        width: metres between them, from all joints' positions.
    """

    closed: float
    open: float
    width: Callable[[Array], float]


@dataclass(frozen=True)
class Pace:
    """How fast the joints' targets may move, radians a second, and a second squared; fingers apart."""

    speed: float
    acceleration: float
    finger_speed: float
    finger_acceleration: float


class MetricArm:
    """Turns metric actions into joint targets, by inverse kinematics from the last targets.

    An action has seven numbers: dx, dy, dz in metres along the base's axes, a rotation vector in radians
    about these axes through the tool centre point, and the gripper in [-1, 1], 1 open. Nothing is clipped;
    deltas add up on the last *target*.

    Args:
        pace: of the drives' targets on their way; None to set them at once.
        yields: whether the hand goes as near to a target out of reach as it can, rather than stay.
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
        self._profile = Profile(pace, len(self._joints)) if pace else None
        self.refused = 0

    def reset(self) -> None:
        """The targets become where the robot is now."""
        self._qpos = np.array(self._robot.qpos, dtype=np.float64)
        self._model.compute_forward_kinematics(self._qpos)
        self.target = self._model.get_link_pose(self._tcp)
        self.refused = 0
        if self._profile:
            self._profile.start(self._qpos)
        self._drive(self._qpos)

    def command(self, action: Array, relative_to: str = "target") -> None:
        """Set the drives' targets for one control step.

        A target out of reach is refused, and counted: the last one stays.
        """
        if relative_to == "current":
            self.target = self._robot.root_pose.inv() * self._link.entity_pose
        target = shifted(self.target, action[:3], action[3:6])
        qpos, found, _ = self._model.compute_inverse_kinematics(
            self._tcp,
            target,
            initial_qpos=self._qpos,
            active_qmask=self._free,
            max_iterations=IK_ITERATIONS,
            dt=IK_STEP,
        )
        found = found and bool(((self._low <= qpos[:-2]) & (qpos[:-2] <= self._high)).all())
        if not found and self._yields:
            qpos, found = self._nearest(target, self._qpos.copy()), True
            target = self._model.get_link_pose(self._tcp)
        if found:
            self.target, self._qpos = target, qpos
        else:
            self.refused += 1
        closed, opened = self.gripper.closed, self.gripper.open
        self._qpos[-2:] = closed + (opened - closed) * (min(max(action[6], -1.0), 1.0) + 1) / 2
        if self._profile is None:
            self._drive(self._qpos)

    def _nearest(self, target: sapien.Pose, qpos: Array) -> Array:
        """As near to a pose as the joints get within their limits, from somewhere on. Place before turn."""
        low, high = self._low + 2e-3, self._high - 2e-3
        for _ in range(NEAREST_ITERATIONS):
            qpos[:-2] = np.clip(qpos[:-2], low, high)
            self._model.compute_forward_kinematics(qpos)
            off = self._model.get_link_pose(self._tcp).inv() * target
            twist = (
                np.concatenate([off.p, Rotation.from_quat(off.q[[1, 2, 3, 0]]).as_rotvec()]) * TWIST_WEIGHTS
            )
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
        """One physics step of the drives' targets on their way, where they have a pace."""
        if self._profile:
            self._drive(self._profile.step(self._qpos, seconds))

    def _drive(self, qpos: Array) -> None:
        for joint, target in zip(self._joints, qpos.tolist(), strict=True):
            joint.set_drive_target(target)


class Profile:
    """Joint positions on their way to targets that may change at any time, without a jump in velocity."""

    def __init__(self, pace: Pace, joints: int) -> None:
        arms = joints - 2
        self._speed = np.repeat([pace.speed, pace.finger_speed], [arms, 2])
        self._acceleration = np.repeat([pace.acceleration, pace.finger_acceleration], [arms, 2])

    def start(self, positions: Array) -> None:
        """Stand still here."""
        self._position, self._velocity = positions.copy(), np.zeros_like(positions)

    def step(self, targets: Array, seconds: float) -> Array:
        """Where the joints should be so many seconds later: as fast as allowed, and braking in time."""
        way = targets - self._position
        braking = np.sqrt(2 * self._acceleration * np.abs(way))
        wanted = np.sign(way) * np.minimum(np.minimum(self._speed, braking), np.abs(way) / seconds)
        change = self._acceleration * seconds
        self._velocity += np.clip(wanted - self._velocity, -change, change)
        self._position = self._position + self._velocity * seconds
        return self._position


class MetricController(BaseController):
    """``MetricArm`` as a ManiSkill controller, for the gymnasium interface."""

    def _initialize_action_space(self) -> None:
        unbounded = np.full(6, np.inf, dtype=np.float32)
        low, high = (np.append(sign * unbounded, np.float32(sign)) for sign in (-1, 1))
        self.single_action_space = spaces.Box(
            low.astype(np.float32), high.astype(np.float32), dtype=np.float32
        )

    def set_drive_property(self) -> None:
        """Those of the config, joint by joint."""
        config = self.config
        for joint in self.joints:
            stiffness, damping, force = config.gains[joint.name]
            joint.set_drive_properties(stiffness, damping, force_limit=force, mode="force")
            joint.set_friction(0.0)
        self.arm = MetricArm(
            self.articulation._objs[0], config.tcp, config.gripper, pace=config.pace, yields=config.yields
        )

    def reset(self) -> None:
        """The targets become where the robot is now."""
        self.arm.reset()

    def set_action(self, action: torch.Tensor) -> None:
        """Command one control step."""
        self.arm.command(np.asarray(action, dtype=np.float64).reshape(-1))


Gains = tuple[float, float, float]  # stiffness, damping, limit of the force


@dataclass
class MetricControllerConfig(ControllerConfig):
    """Names the controlled joints, arm first, their gains, and the tool centre point's link."""

    tcp: str = ""
    gains: Mapping[str, Gains] = field(default_factory=dict)
    gripper: Gripper = Gripper(0.0, 0.0, lambda qpos: 0.0)
    pace: Pace | None = None
    yields: bool = False
    controller_cls = MetricController


@register_agent()
class MetricPanda(Panda):
    """ManiSkill's Panda with ``MetricController``.

    Attributes:
        fingers: the links of each, the one with the pad first: its y axis is the closing axis.
        tool: turns the TCP's link's axes into the hand's, z along the fingers and y the closing axis.
    """

    uid = "vlafuzz_panda"
    tcp_name = "panda_hand_tcp"
    fingers = (("panda_leftfinger",), ("panda_rightfinger",))
    tool: sapien.Pose | None = None
    wrist: str | None = "panda_hand"
    # Below zero, so that a closed gripper presses on thin objects too.
    gripper = Gripper(closed=-0.01, open=0.04, width=lambda qpos: float(qpos[-1] + qpos[-2]))

    def _load_articulation(self, initial_pose: Any = None) -> None:
        """With simplified looks where it will be seen."""
        if self.scene.can_render():
            self.urdf_path = str(light_robot(Path(Panda.urdf_path)))
        super()._load_articulation(initial_pose)

    @property
    def _controller_configs(self) -> dict[str, Any]:
        names: Sequence[str] = [*self.arm_joint_names, *self.gripper_joint_names]
        gains = (Panda.arm_stiffness, Panda.arm_damping, Panda.arm_force_limit)
        config = MetricControllerConfig(
            list(names), tcp=self.tcp_name, gains=dict.fromkeys(names, gains), gripper=self.gripper
        )
        return {CONTROL_MODE: config}
