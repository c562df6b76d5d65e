"""The pendulum of gymnasium, which has to stand upright for a second: continuous actions, stages and an expert."""

from pathlib import Path

import cv2
import gymnasium
import numpy as np

from vlafuzz.model.task import Stage
from vlafuzz.worlds.gym import GymWorld, read_parameters


def upright(now):
    """How near it is to standing upright, in [0, 1]."""
    return (1 + now.observation[0]) / 2


class Pendulum(GymWorld):
    tasks = ("swing-up",)
    parameters = read_parameters(Path(__file__).with_suffix(".yaml"))
    stages = (
        Stage("level", lambda now: now.observation[0] > 0, upright),
        Stage("upright", lambda now: now.observation[0] > 0.97 and abs(now.observation[2]) < 1, upright, steps=20),
    )
    horizon, control_hz = 200, 20
    has_own_start = False  # its own start is drawn

    def make(self, task):
        return gymnasium.make("Pendulum-v1")

    def start(self, env, values, seed):
        _, info = super().start(env, values, seed)
        base = env.unwrapped
        base.state = np.array([np.radians(values["angle"]), values["speed"]])
        return base._get_obs(), info

    def picture(self, now):
        (cos, sin, _), shown = now.observation, np.full((200, 200, 3), 255, np.uint8)
        tip = (int(100 - 80 * sin), int(100 - 80 * cos))
        cv2.line(shown, (100, 100), tip, (200, 120, 40), 8)
        return shown

    def solve(self, now):
        return torque(now.observation, *(now.values[name] for name in ("mass", "length", "gravity")))


def torque(observation, mass=1.0, length=1.0, gravity=10.0):
    """Pumps energy into the pendulum until it can be held upright."""
    cos, sin, speed = observation
    angle, inertia, weight = np.arctan2(sin, cos), mass * length**2 / 3, mass * gravity * length / 2
    if cos > 0.9:
        return np.clip([-inertia * (30 * angle + 8 * speed) - weight * sin], -2, 2)
    energy = inertia * speed**2 / 2 + weight * (cos - 1)
    return np.clip([2.0 if speed == 0 else -5 * energy * speed], -2, 2)


@Pendulum.policy
def tuned(observation):
    """The expert's way for the pendulum as gymnasium has it."""
    return torque(observation)
