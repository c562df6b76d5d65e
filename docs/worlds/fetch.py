"""Fetch pushes a block to a goal: gymnasium-robotics 1.4 (pip install gymnasium-robotics pettingzoo mujoco==3.3.0)."""

from pathlib import Path

import gymnasium
import gymnasium_robotics
import numpy as np

from vlafuzz.worlds.gym import GymWorld, read_parameters

gymnasium.register_envs(gymnasium_robotics)


class Fetch(GymWorld):
    tasks = ("push",)
    parameters = read_parameters(Path(__file__).with_suffix(".yaml"))
    control_hz = 25
    has_own_start = False  # its own start is drawn at random

    def make(self, task):
        return gymnasium.make("FetchPush-v4", render_mode="rgb_array", width=320, height=240)

    def start(self, env, values, seed):
        _, info = super().start(env, values, seed)
        base = env.unwrapped
        block, goal = (np.array([values[f"{what}-x"], values[f"{what}-y"]]) / 100 for what in ("block", "goal"))
        base.data.joint("object0:joint").qpos[:2] = base.initial_gripper_xpos[:2] + block
        base.goal[:2] = base.initial_gripper_xpos[:2] + goal
        base._render_callback()  # marks the goal, and computes where all is
        return base._get_obs(), info

    def picture(self, now):
        return now.env.unwrapped.mujoco_renderer.render("rgb_array")  # its own one changes what follows

    def progress(self, now):
        return max(0.0, 1 - np.linalg.norm(now.observation["achieved_goal"] - now.observation["desired_goal"]) / 0.3)

    def unfair(self, values):
        gap = np.hypot(values["goal-x"] - values["block-x"], values["goal-y"] - values["block-y"])
        return None if gap > 7 else f"the block is {gap:.1f} cm from the goal: less than 7 cm are solved at once"

    def solve(self, now):
        return push(now.observation)


def push(seen):
    """Goes above the block to where it is behind it, and pushes it to the goal; begins anew where it is off the way."""
    hand, block, goal = seen["observation"][:3], seen["achieved_goal"], seen["desired_goal"]
    way = (goal - block)[:2] / np.linalg.norm((goal - block)[:2])
    off = (hand - block)[:2] + 0.09 * way  # from the place behind the block
    along, high = off @ way, hand[2] - block[2]
    if not -0.03 < along < (0.02 if high > 0.02 else 0.08) or np.linalg.norm(off - along * way) > 0.02:  # not behind it
        to = np.append(off if high < 0.06 and np.linalg.norm(off) > 0.03 else 0 * off, 0.1)
    elif high > 0.02:
        to = np.zeros(3)
    else:
        to = np.append(off + 0.1 * way - 0.5 * (off - along * way), 0)
    return np.clip(np.append(12 * (to - np.append(off, high)), 0), -1, 1)


@Fetch.policy
def gentle(seen):
    """The expert's way with less force: it moves the hand towards a place that is less far ahead."""
    return 0.4 * push(seen)
