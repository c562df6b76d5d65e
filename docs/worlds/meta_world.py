r"""Meta-World's tasks with an object and a goal, and its scripted policies as experts.

Meta-World needs MuJoCo 3.3.0, so it gets its own environment, without the tabletop simulator::

    python -m venv .venv-metaworld && . .venv-metaworld/bin/activate
    pip install metaworld==3.1.1 filelock packaging typer rich pydantic pyyaml scipy platformdirs jinja2 matplotlib \
        imageio-ffmpeg opencv-python-headless
    pip install --no-deps -e path/to/vlafuzz
    MUJOCO_GL=egl vlafuzz run --world python:meta_world:MetaWorld:push-v3 --policy python:meta_world:push --budget 200
"""

import warnings
from collections import deque
from pathlib import Path

import numpy as np
from metaworld.env_dict import ALL_V3_ENVIRONMENTS
from metaworld.policies import ENV_POLICY_MAP

from vlafuzz.worlds.gym import GymWorld, read_parameters

FACTORS = ("mass", "friction", "gravity")
NEAR = 0.15  # metres between object and goal, below which Meta-World draws another scene


class MetaWorld(GymWorld):
    """The values replace what Meta-World draws: the vector of object and goal, and the hand's start."""

    tasks = ("reach-v3", "push-v3", "pick-place-v3", "soccer-v3", "push-wall-v3", "pick-place-wall-v3")
    parameters = read_parameters(Path(__file__).with_suffix(".yaml"))
    horizon, control_hz = 200, 80
    packages = ("mujoco",)
    has_own_start = False  # Meta-World draws every start

    def make(self, task):
        env = ALL_V3_ENVIRONMENTS[task](render_mode="rgb_array", camera_name="corner3", height=240, width=320)
        env._set_task_called = env._freeze_rand_vec = True
        env._partially_observable = False  # as in MT1: the goal is part of what a policy sees
        del env.sawyer_observation_space  # made for a hidden goal; it is made again when it is needed
        env.object = env._get_id_main_object() if task != "reach-v3" else env.model.geom("objGeom").id
        body, model = env.model.geom_bodyid[env.object], env.model
        env.usual = {
            "hand": env.hand_init_pos.copy(),
            "mass": model.body_mass[body],
            "inertia": model.body_inertia[body].copy(),
            "friction": model.geom_friction[env.object].copy(),
            "gravity": model.opt.gravity.copy(),
        }
        return env

    def apply(self, env, values):
        box, usual, model = env._random_reset_space, env.usual, env.model
        moved = np.array([values[name] for name in ("object-x", "object-y", "goal-x", "goal-y")]) / 100
        env._last_rand_vec = (box.low + box.high) / 2 + [*moved[:2], 0, *moved[2:], 0]
        env.hand_init_pos = usual["hand"] + [values["hand-x"] / 100, 0, values["hand-z"] / 100]
        body = model.geom_bodyid[env.object]
        model.body_mass[body] = usual["mass"] * values["mass"]
        model.body_inertia[body] = usual["inertia"] * values["mass"]
        model.geom_friction[env.object] = usual["friction"] * values["friction"]
        model.opt.gravity[:] = usual["gravity"] * values["gravity"]

    def applied(self, now):
        env = now.env
        mass = env.model.body_mass[env.model.geom_bodyid[env.object]] / env.usual["mass"]
        friction = env.model.geom_friction[env.object][0] / env.usual["friction"][0]
        return {"mass": mass, "friction": friction, "gravity": env.model.opt.gravity[2] / env.usual["gravity"][2]}

    def instruction(self, task, values):
        return task.removesuffix("-v3").replace("-", " ")

    def unfair(self, values):
        near = np.hypot(values["goal-x"] - values["object-x"], 20 + values["goal-y"] - values["object-y"]) / 100
        return None if near >= NEAR else f"object and goal are {near:.2f} m apart, less than {NEAR} m"

    def progress(self, now):
        return max(0.0, 1 - now.info.get("obj_to_target", 0.25) / 0.25)

    def solve(self, now):
        return scripted(now.task, now.observation)


def scripted(task, observation):
    """Meta-World's own policy."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it says more than the actions' bounds
        return np.clip(ENV_POLICY_MAP[task]().get_action(observation), -1, 1).astype(np.float32)


class Late:
    """The scripted policy of a task, which acts on what it saw four steps ago, 50 ms."""

    def __init__(self, task):
        self.task = task

    def reset(self, seed):
        self.seen = deque(maxlen=5)

    def act(self, observation):
        self.seen.append(observation)
        return scripted(self.task, self.seen[0])


reach, push, pick_place, soccer, push_wall, pick_place_wall = (
    MetaWorld.policy(Late(task), name=f"late-{task}") for task in MetaWorld.tasks
)
