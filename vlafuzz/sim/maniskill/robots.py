"""The Panda with our own end-effector controller, in metres.

ManiSkill 3.0.1's ``pd_ee_delta_pose`` turns the wrong way (issue 1469) and clips; this one does neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
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

from vlafuzz.sim.maniskill.meshes import light_robot

Array = NDArray[np.float64]
CONTROL_MODE = "metric_ee"
# Finger positions for a gripper command of -1 and +1. Below zero, so that a closed gripper presses on thin
# objects too.
CLOSED, OPEN = -0.01, 0.04
# Half a Newton step an iteration converges in a dozen. SAPIEN's default of a tenth takes four times as long,
# and a whole one overshoots near the joints' limits (4 % fewer targets are found there).
IK_STEP, IK_ITERATIONS = 0.5, 50


def shifted(pose: sapien.Pose, shift: Array, turn: Array) -> sapien.Pose:
    """A pose moved by ``(3,)`` metres and turned in place by a ``(3,)`` rotation vector in radians."""
    x, y, z = turn.tolist()
    angle = math.hypot(x, y, z)
    sine = math.sin(angle / 2) / angle if angle > 1e-12 else 0.5
    by = sapien.Pose(q=[math.cos(angle / 2), x * sine, y * sine, z * sine])
    return sapien.Pose(pose.p + shift, (by * sapien.Pose(q=pose.q)).q)


class MetricArm:
    """Turns metric actions into joint targets, by inverse kinematics from the last targets.

    An action has seven numbers: dx, dy, dz in metres along the base's axes, a rotation vector in radians
    about these axes through the tool centre point, and the gripper in [-1, 1], 1 open. Nothing is clipped;
    deltas add up on the last *target*.
    """

    def __init__(self, robot: sapien.physx.PhysxArticulation, tcp_name: str) -> None:
        self._robot = robot
        self._tcp = next(i for i, link in enumerate(robot.links) if link.name.endswith(tcp_name))
        self._link = robot.links[self._tcp]
        self._model = robot.create_pinocchio_model()
        self._joints = robot.active_joints
        self._free = np.repeat([1, 0], [len(self._joints) - 2, 2])
        low, high = np.array(robot.qlimits[:-2], dtype=np.float64).T
        self._low, self._high = low - 1e-3, high + 1e-3
        self.refused = 0

    def reset(self) -> None:
        """The targets become where the robot is now."""
        self._qpos = np.array(self._robot.qpos, dtype=np.float64)
        self._model.compute_forward_kinematics(self._qpos)
        self.target = self._model.get_link_pose(self._tcp)
        self.refused = 0
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
        if found and ((self._low <= qpos[:-2]) & (qpos[:-2] <= self._high)).all():
            self.target, self._qpos = target, qpos
        else:
            self.refused += 1
        self._qpos[-2:] = CLOSED + (OPEN - CLOSED) * (min(max(action[6], -1.0), 1.0) + 1) / 2
        self._drive(self._qpos)

    def _drive(self, qpos: Array) -> None:
        for joint, target in zip(self._joints, qpos.tolist(), strict=True):
            joint.set_drive_target(target)


class MetricController(BaseController):
    """``MetricArm`` as a ManiSkill controller, for the gymnasium interface."""

    def _initialize_action_space(self) -> None:
        unbounded = np.full(6, np.inf, dtype=np.float32)
        low, high = (np.append(sign * unbounded, np.float32(sign)) for sign in (-1, 1))
        self.single_action_space = spaces.Box(
            low.astype(np.float32), high.astype(np.float32), dtype=np.float32
        )

    def set_drive_property(self) -> None:
        """Gains of ManiSkill's own Panda."""
        for joint in self.joints:
            joint.set_drive_properties(
                Panda.arm_stiffness, Panda.arm_damping, force_limit=Panda.arm_force_limit, mode="force"
            )
            joint.set_friction(0.0)
        self.arm = MetricArm(self.articulation._objs[0], self.config.tcp)

    def reset(self) -> None:
        """The targets become where the robot is now."""
        self.arm.reset()

    def set_action(self, action: torch.Tensor) -> None:
        """Command one control step."""
        self.arm.command(np.asarray(action, dtype=np.float64).reshape(-1))


@dataclass
class MetricControllerConfig(ControllerConfig):
    """Names the controlled joints, arm first, and the tool centre point's link."""

    tcp: str = "panda_hand_tcp"
    controller_cls = MetricController


@register_agent()
class MetricPanda(Panda):
    """ManiSkill's Panda with ``MetricController``."""

    uid = "vlafuzz_panda"

    def _load_articulation(self, initial_pose: Any = None) -> None:
        """With simplified looks where it will be seen."""
        if self.scene.can_render():
            self.urdf_path = str(light_robot(Path(Panda.urdf_path)))
        super()._load_articulation(initial_pose)

    @property
    def _controller_configs(self) -> dict[str, Any]:
        names: Sequence[str] = [*self.arm_joint_names, *self.gripper_joint_names]
        return {CONTROL_MODE: MetricControllerConfig(joint_names=list(names))}
