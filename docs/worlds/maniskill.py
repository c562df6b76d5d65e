"""ManiSkill's own tasks by their registered names: the cube, its goal and the arm are placed after each reset."""

from pathlib import Path
from unittest.mock import patch

import gymnasium
import mani_skill.envs  # noqa: F401 - registers the tasks
import numpy as np
import sapien
from mani_skill.utils import building, common
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

from vlafuzz.worlds.gym import GymWorld, read_parameters

TASKS = {  # by names here: ManiSkill's, the object, the goal with its height in metres, and where along x it is
    "pick-cube": ("PickCube-v1", "cube", "goal_site", 0.15, 1),
    "stack-cube": ("StackCube-v1", "cubeA", "cubeB", 0.02, 1),
    "place-sphere": ("PlaceSphere-v1", "obj", "bin", 0.0025, 1),
    "push-cube": ("PushCube-v1", "obj", "goal_region", 0.001, 1),
    "pull-cube": ("PullCube-v1", "obj", "goal_region", 0.001, -1),
}
PARAMETERS = read_parameters(Path(__file__).with_suffix(".yaml"))
ABOVE, BEFORE = np.array([0, 0, 0.08]), np.array([0.06, 0, 0])  # metres
LYING = np.sqrt([0.5, 0, 0.5, 0]) * [1, 1, -1, 1]  # the goal of push-cube and pull-cube is a disc


class ManiSkill(GymWorld):
    """Every reset builds its scene anew: without that, steps do not repeat bit for bit."""

    parameters = tuple(one for one in PARAMETERS if one.group not in ("camera", "light"))
    tasks, horizon, control_hz = tuple(TASKS), 100, 20
    packages, has_own_start = ("sapien",), False  # ManiSkill draws every start
    drawing = {"render_backend": "none"}  # noqa: RUF012

    def make(self, task):
        how = {"obs_mode": "state_dict", "control_mode": "pd_ee_delta_pos", "sim_backend": "cpu", **self.drawing}
        env = gymnasium.make(TASKS[task][0], max_episode_steps=self.horizon, **how)
        env.told = TASKS[task]
        return CPUGymWrapper(env)

    def start(self, env, values, seed):
        def sized(*where, half_size, name, **look):  # StackCube asks nobody how large its cubes are
            return build(*where, half_size=tall if name == "cubeA" else half_size, name=name, **look)

        base, (_, thing, goal, height, way), build = env.unwrapped, env.env.told, building.actors.build_cube
        base.cube_half_size = base.radius = tall = 0.02 * values["size"]
        with patch.object(building.actors, "build_cube", sized):
            env.reset(seed=seed, options={"reconfigure": True})
        thing, goal, half = getattr(base, thing), getattr(base, goal), np.radians(values["turn"]) / 2
        x, y, away = (values[name] / 100 for name in ("object-x", "object-y", "distance"))
        thing.set_pose(sapien.Pose([x, y, tall], [np.cos(half), 0, 0, np.sin(half)]))
        goal.set_pose(sapien.Pose([x + way * away, y, height], LYING if height < 0.002 else [1, 0, 0, 0]))
        body = thing._objs[0].find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
        body.mass *= values["mass"]
        for shape in body.collision_shapes:
            shape.physical_material = sapien.physx.PhysxMaterial(values["friction"], values["friction"], 0)
        base.agent.reset(base.agent.keyframes["rest"].qpos + np.radians(values["elbow"]) * np.eye(9)[3])
        return common.unbatch(*map(common.to_numpy, (base.get_obs(info := base.get_info()), info)))

    def progress(self, now):
        return float(np.clip(1 - np.linalg.norm(np.subtract(*places(now.observation)[1:])) / 0.3, 0, 1))

    def solve(self, now):
        return push(now.observation) if now.task in ("push-cube", "pull-cube") else pick(now.observation)


class Drawn(ManiSkill):
    """The same with pictures, in which camera and light vary, too; they need a Vulkan device."""

    parameters = PARAMETERS
    drawing = {"render_mode": "rgb_array"}  # noqa: RUF012

    def start(self, env, values, seed):
        started, scene = super().start(env, values, seed), env.unwrapped.scene
        moved = sapien.Pose([0, values["camera-left"] / 100, values["camera-up"] / 100])
        moved.set_rpy(np.radians([0, values["camera-pitch"], values["camera-yaw"]]))
        (camera,), drawn = scene.human_render_cameras.values(), scene.sub_scenes[0].render_system
        camera.camera.set_local_pose(camera.config.pose.sp * moved)
        drawn.ambient_light = drawn.ambient_light * values["light"]
        for one in drawn.lights:
            one.color = one.color * values["light"]
        return started


def places(seen):
    """Where hand, object and goal are, in metres."""
    extra = seen["extra"]
    on = extra["bin_pos"] + [0, 0, 0.0225] if "bin_pos" in extra else extra.get("cubeB_pose", ABOVE)[:3] + ABOVE / 2
    return extra["tcp_pose"][:3], extra.get("obj_pose", extra.get("cubeA_pose"))[:3], extra.get("goal_pos", on)


def pick(seen, hurry=1.0):
    """Goes above the object, down, closes, and carries it to the goal."""
    (hand, thing, goal), fingers = places(seen), seen["agent"]["qpos"][-1]
    gap, stacks = thing - hand, "goal_pos" not in seen["extra"]
    if stacks and np.linalg.norm((goal - thing)[:2]) < 0.01 and abs((goal - thing)[2]) < 0.005:
        return act([0, 0, 0.05], 1)
    if np.linalg.norm(gap) < 0.02 and fingers < 0.03:
        low = np.linalg.norm((goal - thing)[:2]) > 0.02 and thing[2] < goal[2] + 0.02
        return act([0, 0, 0.05] if low else hurry * (goal - thing + [0, 0, 0.03 * stacks * low]), -1)
    beside, near = np.linalg.norm(gap[:2]) > 0.01 and gap[2] > -0.1, np.linalg.norm(gap) <= 0.01
    return act(gap + ABOVE * beside, -1 if near else 1)


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


hasty = ManiSkill.policy(lambda seen: pick(seen, hurry=4.0), name="hasty")  # carries things as fast as it can
