"""The robots as ManiSkill agents with a metric controller: the Panda, VLATest's WidowX 250s and Google robot.

The files of the last two are in the user's packs. Their gains, limits and friction are the reference's (SIMPLER's
``configs/{widowx,google_robot}/defaults.py``, tuned there to the real robots' motion); the WidowX's are taken from
ManiSkill's own bridge agent.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium import spaces
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig
from mani_skill.agents.registration import register_agent
from mani_skill.agents.robots.panda import Panda
from mani_skill.envs.tasks.digital_twins.bridge_dataset_eval.base_env import WidowX250SBridgeDatasetFlatTable

from vlafuzz.common import assets
from vlafuzz.worlds.manipulation.rigs import GOOGLE, WIDOWX, Rig
from vlafuzz.worlds.tabletop.objects.packs import check_references
from vlafuzz.worlds.tabletop.sim.arm import Gripper, MetricArm, Pace

CONTROL_MODE = "metric_ee"


class MetricController(BaseController):
    """``MetricArm`` as a ManiSkill controller."""

    def _initialize_action_space(self) -> None:
        high = np.array([*[np.inf] * 6, 1.0], dtype=np.float32)
        self.single_action_space = spaces.Box(-high, high, dtype=np.float32)

    def set_drive_property(self) -> None:
        """Apply the gains of the config, joint by joint."""
        agent = self.config.agent
        for joint in self.joints:
            stiffness, damping, force = agent.gains[joint.name]
            joint.set_drive_properties(stiffness, damping, force_limit=force, mode="force")
            joint.set_friction(0.0)
        self.arm = MetricArm(
            self.articulation._objs[0], agent.tcp_name, agent.gripper, pace=agent.pace, yields=agent.yields
        )

    def reset(self) -> None:
        self.arm.reset()

    def set_action(self, action: torch.Tensor) -> None:
        self.arm.command(np.asarray(action, dtype=np.float64).reshape(-1))


Gains = tuple[float, float, float]  # stiffness, damping, force limit


@dataclass(kw_only=True)
class MetricControllerConfig(ControllerConfig):
    """The controlled joints, arm first, of an agent."""

    agent: "type[_Metric]"
    controller_cls = MetricController


class _Metric(BaseAgent):
    """A robot with ``MetricController``.

    Attributes:
        gains: of the joints, arm first. tcp_name: the link of the tool centre point.
        fingers: the links of each finger, first the one with the pad; its y axis is the closing axis. tool: from the
        TCP link's axes to the hand's, z along the fingers and y the closing axis. wrist: the link for a wrist camera;
        None if there is none. pace, yields: see ``MetricArm``.
    """

    gains: Mapping[str, Gains]
    tcp_name: str
    gripper: Gripper
    fingers: tuple[tuple[str, ...], ...]
    tool: sapien.Pose | None = None
    wrist: str | None = None
    pace: Pace | None = None
    yields = False

    @property
    def _controller_configs(self) -> dict[str, Any]:
        return {CONTROL_MODE: MetricControllerConfig(joint_names=list(self.gains), agent=type(self))}


@register_agent()
class MetricPanda(_Metric, Panda):
    """ManiSkill's Panda, whose visual meshes are simplified: ``scripts/make_panda.py``."""

    uid = "vlafuzz_panda"
    urdf_path = str(assets.operators_dir() / "robots" / "panda" / "panda_v2.urdf")
    tcp_name = "panda_hand_tcp"
    fingers = (("panda_leftfinger",), ("panda_rightfinger",))
    wrist = "panda_hand"
    gains = dict.fromkeys(
        (*Panda.arm_joint_names, *Panda.gripper_joint_names),
        (Panda.arm_stiffness, Panda.arm_damping, Panda.arm_force_limit),
    )
    # Closed is below zero, so that the gripper also presses on thin objects.
    gripper = Gripper(closed=-0.01, open=0.04, width=lambda qpos: float(qpos[-1] + qpos[-2]))


class _FromPack(_Metric):
    """A robot whose files are in a pack.

    Its hand yields out of reach; the reference exceeds joint limits there, or does not move at all.
    """

    rig: Rig
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


def _bridge_gains() -> dict[str, Gains]:
    bridge: Any = WidowX250SBridgeDatasetFlatTable
    arm = zip(bridge.arm_stiffness, bridge.arm_damping, bridge.arm_force_limit, strict=True)
    fingers = (bridge.gripper_stiffness, bridge.gripper_damping, bridge.gripper_force_limit)
    return {**dict(zip(bridge.arm_joint_names, arm, strict=True)), **dict.fromkeys(bridge.gripper_joint_names, fingers)}


@register_agent()
class MetricWidowX(_FromPack, WidowX250SBridgeDatasetFlatTable):
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
    gains = _bridge_gains()

    @property
    def _sensor_configs(self) -> list[Any]:
        return []  # the rig defines the camera


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
    # Of arm_pd_ee_delta_pose_align_interpolate_by_planner and
    # gripper_pd_joint_target_delta_pos_interpolate_by_planner, except for the fingers' force limit of 60:
    # they would press on an orange with 900 N, at which SAPIEN 3's solver holds the arm off its target.
    gains = {  # noqa: RUF012
        "joint_torso": (1700.0, 1059.9791902443303, 300),
        "joint_shoulder": (1737.0471680861954, 1010.4720585373592, 300),
        "joint_bicep": (979.975871856535, 767.2803161582076, 100),
        "joint_elbow": (930.0, 680.0, 100),
        "joint_forearm": (1212.154500274304, 674.9946964336588, 100),
        "joint_wrist": (432.96500923932535, 274.613381336198, 100),
        "joint_gripper": (468.0013365498738, 340.532560578637, 100),
        "joint_head_pan": (2000, 900, 100),
        "joint_head_tilt": (2000, 900, 100),
        "joint_finger_right": (200, 8, 10),
        "joint_finger_left": (200, 8, 10),
    }
    # The reference planner's limits without that of the jerk, 50 rad/s^3, which delays each change of
    # acceleration by 0.04 s.
    pace = Pace(speed=1.5, acceleration=2.0, finger_speed=1.0, finger_acceleration=7.0)


AGENTS: dict[str | None, type[BaseAgent]] = {None: MetricPanda, WIDOWX.urdf: MetricWidowX, GOOGLE.urdf: MetricGoogle}
