"""The robots whose files are the user's: VLATest's WidowX 250s and Google robot, with ``MetricController``.

Gains, limits and friction are the reference's (SIMPLER's ``configs/{widowx,google_robot}/defaults.py``,
tuned there to the real robots' motion): the WidowX's by way of ManiSkill's own bridge agent.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.registration import register_agent
from mani_skill.envs.tasks.digital_twins.bridge_dataset_eval.base_env import WidowX250SBridgeDatasetFlatTable
from numpy.typing import NDArray

from vlafuzz import assets
from vlafuzz.errors import UsageError
from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import GOOGLE, WIDOWX
from vlafuzz.sim.maniskill.robots import (
    CONTROL_MODE,
    Gains,
    Gripper,
    MetricControllerConfig,
    MetricPanda,
    Pace,
)


def _friction(**links: float) -> dict[str, Any]:
    """ManiSkill's ``urdf_config``: the friction of links; their patch lets a finger hold against a turn."""
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
class MetricWidowX(WidowX250SBridgeDatasetFlatTable):
    """See ``MetricPanda`` for the attributes."""

    uid = "vlafuzz_widowx"
    disable_self_collisions = True  # its hand's meshes overlap: as SAPIEN 3 loads them, the fingers are stuck
    tcp_name = "ee_gripper_link"
    fingers = (("left_finger_link",), ("right_finger_link",))
    tool: sapien.Pose | None = sapien.Pose(q=[0.5**0.5, 0.0, 0.5**0.5, 0.0])  # its x is along the fingers
    wrist: str | None = None
    # A millimetre beyond the joints' limits, as there: so there is force at either end. Between the
    # fingers' collision meshes there are 22 mm less than the joints say.
    gripper = Gripper(closed=0.014, open=0.038, width=lambda qpos: float(qpos[-1] + qpos[-2]) - 0.022)
    urdf_config = _friction(left_finger_link=2.0, right_finger_link=2.0)

    def _load_articulation(self, initial_pose: Any = None) -> None:
        self.urdf_path = _file(WIDOWX)
        super()._load_articulation(initial_pose)

    @property
    def _sensor_configs(self) -> list[Any]:
        return []  # the rig has the camera

    @property
    def _controller_configs(self) -> dict[str, Any]:
        arm = zip(self.arm_stiffness, self.arm_damping, self.arm_force_limit, strict=True)
        fingers: Gains = (self.gripper_stiffness, self.gripper_damping, self.gripper_force_limit)
        gains: dict[str, Gains] = dict(zip(self.arm_joint_names, arm, strict=True))
        gains |= dict.fromkeys(self.gripper_joint_names, fingers)
        return _control(self.tcp_name, gains, self.gripper)


# Metres between the Google robot's fingers at joint positions, measured on the collision meshes.
_JOINT, _WIDTH = (0.0, 0.3, 0.6, 0.9, 1.15), (0.141, 0.114, 0.081, 0.031, 0.0)


def _google_width(qpos: NDArray[np.float64]) -> float:
    return float(np.interp((qpos[-1] + qpos[-2]) / 2, _JOINT, _WIDTH))


@register_agent()
class MetricGoogle(BaseAgent):
    """See ``MetricPanda`` for the attributes."""

    uid = "vlafuzz_google"
    tcp_name = "link_gripper_tcp"
    fingers = tuple(
        (f"link_finger_tip_{side}", f"link_finger_{side}", f"link_finger_nail_{side}")
        for side in ("left", "right")
    )
    tool: sapien.Pose | None = None
    wrist: str | None = None
    gripper = Gripper(closed=1.31, open=0.0, width=_google_width)  # a hundredth beyond the limit, as there
    urdf_config = _friction(
        **dict.fromkeys((name for finger in fingers for name in finger[:2]), 2.0),
        **dict.fromkeys((finger[2] for finger in fingers), 0.1),
    )
    # joint: stiffness, damping, force limit, of arm_pd_ee_delta_pose_align_interpolate_by_planner and
    # gripper_pd_joint_target_delta_pos_interpolate_by_planner. But for the fingers' limit, there 60: they
    # would press on an orange with 900 N, and then SAPIEN 3's solver holds the arm fast, off its target.
    gains: dict[str, Gains] = {  # noqa: RUF012
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
    # Its planner's limits; that of the jerk, 50 rad/s^3, is left out: it costs 0.04 s at each change of
    # acceleration.
    pace = Pace(speed=1.5, acceleration=2.0, finger_speed=1.0, finger_acceleration=7.0)

    def _load_articulation(self, initial_pose: Any = None) -> None:
        self.urdf_path = _file(GOOGLE)
        super()._load_articulation(initial_pose)

    @property
    def _controller_configs(self) -> dict[str, Any]:
        return _control(self.tcp_name, self.gains, self.gripper, self.pace)


def _control(tcp: str, gains: dict[str, Gains], gripper: Gripper, pace: Pace | None = None) -> dict[str, Any]:
    """Beyond reach the hand yields; there, joints are sent beyond their limits, or all of them stay."""
    config = MetricControllerConfig(
        list(gains), tcp=tcp, gains=gains, gripper=gripper, pace=pace, yields=True
    )
    return {CONTROL_MODE: config}


def _file(rig: Rig) -> str:
    assert rig.urdf is not None
    return str(assets.need(f"robots/{rig.urdf}", f"robot {rig.robot}"))


AGENTS: dict[str | None, type[BaseAgent]] = {
    None: MetricPanda,
    WIDOWX.urdf: MetricWidowX,
    GOOGLE.urdf: MetricGoogle,
}


def wrist_of(agent: BaseAgent) -> Any:
    """The link that a wrist camera sits on.

    Raises:
        UsageError: this robot has none.
    """
    if agent.wrist is None:
        raise UsageError(
            f"{agent.uid.removeprefix('vlafuzz_')}: it has no wrist camera", hint="ask for third_person only"
        )
    return agent.robot.links_map[agent.wrist]
