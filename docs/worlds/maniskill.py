"""ManiSkill's own tasks by their registered names: the cube, its goal and the arm are placed after each reset."""

from pathlib import Path

import gymnasium
import mani_skill.envs  # noqa: F401 - registers the tasks
import numpy as np
import sapien
from mani_skill.utils import common
from mani_skill.utils.structs.pose import Pose
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from sapien.physx import PhysxMaterial, PhysxRigidDynamicComponent

from vlafuzz.worlds.gym import GymWorld, read_parameters

# The name of a task here, ManiSkill's, its object and its goal with the height in metres.
TASKS = {
    "pick-cube": ("PickCube-v1", "cube", "goal_site", 0.15),
    "stack-cube": ("StackCube-v1", "cubeA", "cubeB", 0.02),
    "place-sphere": ("PlaceSphere-v1", "obj", "bin", 0.0025),
    "push-cube": ("PushCube-v1", "obj", "goal_region", 0.001),
    "pull-cube": ("PullCube-v1", "obj", "goal_region", 0.001),
}
REST = np.array([0, np.pi / 8, 0, -np.pi * 5 / 8, 0, np.pi * 3 / 4, np.pi / 4, 0.04, 0.04])  # joints of a Panda
ABOVE, BEFORE = np.array([0, 0, 0.08]), np.array([0.06, 0, 0])  # metres
LYING = np.sqrt([0.5, 0, 0.5, 0]) * [1, 1, -1, 1]  # the goal of push-cube and pull-cube is a disc


class ManiSkill(GymWorld):
    """Every reset builds its scene anew: without that, steps do not repeat bit for bit."""

    tasks = tuple(TASKS)
    parameters = read_parameters(Path(__file__).with_suffix(".yaml"))
    horizon, control_hz = 100, 20
    packages = ("sapien",)
    has_own_start = False  # ManiSkill draws every start
    drawing = {"render_backend": "none"}  # noqa: RUF012

    def make(self, task):
        env = gymnasium.make(
            TASKS[task][0],
            obs_mode="state_dict",
            control_mode="pd_ee_delta_pos",
            sim_backend="cpu",
            max_episode_steps=self.horizon,
            **self.drawing,
        )
        env.task = task
        return CPUGymWrapper(env)

    def start(self, env, values, seed):
        env.reset(seed=seed, options={"reconfigure": True})
        base, (_, thing, goal, height) = env.unwrapped, TASKS[env.env.task]
        x, y, half = values["object-x"] / 100, values["object-y"] / 100, np.radians(values["turn"]) / 2
        thing, goal = getattr(base, thing), getattr(base, goal)
        thing.set_pose(Pose.create(sapien.Pose([x, y, 0.02], [np.cos(half), 0, 0, np.sin(half)])))
        lying = LYING if height < 0.002 else [1, 0, 0, 0]
        x += values["distance"] / 100 * (-1 if env.env.task == "pull-cube" else 1)
        goal.set_pose(Pose.create(sapien.Pose([x, y, height], lying)))
        body = thing._objs[0].find_component_by_type(PhysxRigidDynamicComponent)
        body.mass *= values["mass"]
        for shape in body.collision_shapes:
            shape.physical_material = PhysxMaterial(values["friction"], values["friction"], 0)
        base.agent.reset(REST + np.radians(values["elbow"]) * np.eye(9)[3])
        info = base.get_info()
        return common.unbatch(common.to_numpy(base.get_obs(info)), common.to_numpy(info))

    def progress(self, now):
        _, thing, goal = places(now.observation)
        return float(np.clip(1 - np.linalg.norm(goal - thing) / 0.3, 0, 1))

    def solve(self, now):
        return push(now.observation) if now.task in ("push-cube", "pull-cube") else pick(now.observation)


class Drawn(ManiSkill):
    """The same with pictures, which need a Vulkan device."""

    drawing = {"render_mode": "rgb_array"}  # noqa: RUF012


def places(seen):
    """Where hand, object and goal are, in metres."""
    extra = seen["extra"]
    thing = extra["obj_pose"] if "obj_pose" in extra else extra["cubeA_pose"]
    if "goal_pos" in extra:
        return extra["tcp_pose"][:3], thing[:3], extra["goal_pos"]
    on = extra["bin_pos"] + [0, 0, 0.0225] if "bin_pos" in extra else extra["cubeB_pose"][:3] + ABOVE / 2
    return extra["tcp_pose"][:3], thing[:3], on


def pick(seen, hurry=1.0):
    """Goes above the object, down, closes, and carries it to the goal."""
    (hand, thing, goal), fingers = places(seen), seen["agent"]["qpos"][-1]
    gap, stacks = thing - hand, "goal_pos" not in seen["extra"]
    if stacks and np.linalg.norm((goal - thing)[:2]) < 0.01 and abs((goal - thing)[2]) < 0.005:
        return act([0, 0, 0.05], 1)
    if np.linalg.norm(gap) < 0.02 and fingers < 0.03:
        low = np.linalg.norm((goal - thing)[:2]) > 0.02 and thing[2] < goal[2] + 0.02
        return act([0, 0, 0.05] if low else hurry * (goal - thing + [0, 0, 0.03 * stacks * low]), -1)
    if np.linalg.norm(gap[:2]) > 0.01 and gap[2] > -0.1:
        return act(gap + ABOVE, 1)
    return act(gap, 1 if np.linalg.norm(gap) > 0.01 else -1)


def push(seen):
    """Goes behind the object, down, and pushes it to the goal, which is beyond it or nearer."""
    hand, thing, goal = places(seen)
    side = np.sign((goal - thing)[0])
    behind = thing - hand - side * BEFORE
    if side * behind[0] > -0.03 and np.linalg.norm(behind[1:]) < 0.01:
        return act([(goal - thing)[0] * 0.5 + side * 0.02, behind[1], 0], -1)
    return act(behind if abs(behind[0]) < 0.02 else behind + ABOVE, -1)


def act(move, grip):
    """A move in metres, of which the controller makes 0.1 at most, and a command to the fingers."""
    return np.array([*np.clip(np.asarray(move) / 0.1, -1, 1), grip], np.float32)


@ManiSkill.policy
def hasty(seen):
    """Carries things as fast as it can."""
    return pick(seen, hurry=4.0)
