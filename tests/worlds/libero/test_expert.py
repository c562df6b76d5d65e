"""LIBERO's expert, its demonstrations, and what the policy that was trained on them does."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from tests.exports.test_demonstrations import of_policy
from vlafuzz.exports.demonstrations import ExpertRunner
from vlafuzz.model import Conditions, Light, Monitor, Verdict
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.expert import Expert
from vlafuzz.worlds.libero.grasps import find_grasps
from vlafuzz.worlds.libero.space import nominal_scene
from vlafuzz.worlds.libero.stages import Moment, find_stages
from vlafuzz.worlds.libero.suites import SETTLING

pytestmark = pytest.mark.libero
SCRIPTS = Path(__file__).parents[3] / "scripts"


def rollout(env: LiberoEnv, actions) -> list[str]:
    moment, monitor = Moment(env), Monitor(find_stages(env.task))
    for action in actions:
        assert np.abs(action).max() <= 1.0
        env.step(action)
        monitor.observe(moment)
        if monitor.success_once:
            break
    return monitor.reached


def test_the_expert_puts_the_bowl_on_the_plate_by_all_stages(bowls):
    bowls.reset(1)
    bowls.settle(SETTLING)
    assert rollout(bowls, islice(Expert(bowls).actions(), bowls.task.horizon)) == ["reach", "grasp", "move", "goal"]


def test_a_bowl_is_taken_by_its_rim(bowls):
    bowls.reset()
    bowls.settle(SETTLING)
    place = bowls.data.body("akita_black_bowl_1_main").xpos
    best = find_grasps(bowls, "akita_black_bowl_1")[0]
    assert 0.03 < np.linalg.norm((best.position - place)[:2]) < 0.08


@pytest.mark.parametrize(
    ("policy", "layout", "least"),
    [
        ("openpi:ws://gpu:8000?profile=libero", ("left", "right"), 80),
        ("openpi:ws://gpu:8000?hz=5&camera=128&state=1", ("opening",), 20),
    ],
)
def test_a_scene_of_libero_is_demonstrated_as_its_policy_sees_and_acts(policy, layout, least):
    scene = replace(nominal_scene("libero_object/3", "libero", 2), light=Light(0.8))
    runner = ExpertRunner(replace(of_policy(policy), task=scene.task, world={"quality": "fast"}))
    shown = runner.show(scene)
    assert not isinstance(shown, str)
    names = tuple(runner.interface.state_names[6:])
    runner.close()
    assert names == layout
    assert shown.states.shape == (len(shown.actions), 6 + len(layout))
    assert least < len(shown.actions) < 4 * least
    assert all(len(pictures) == len(shown.actions) for pictures in shown.pictures.values())
    assert set(np.sign(shown.actions[:, -1])) == {-1.0, 1.0}


def call(script: str, *arguments: object) -> None:
    subprocess.run([sys.executable, str(SCRIPTS / script), *map(str, arguments)], check=True)


@pytest.mark.parametrize("task", ["libero_object/2", "libero_object/7"])
def test_it_solves_initial_states_that_it_was_not_shown(task):
    conditions = Conditions(task=task, robot="libero", world={"quality": "fast"}, stop_early=True)
    evaluator = make_evaluator(conditions, make_policy("mini-libero"))
    scenes = [nominal_scene(task, "libero", state) for state in range(3)]
    verdicts = [outcome.verdict for outcome in evaluator.evaluate(scenes)]
    evaluator.close()
    assert verdicts.count(Verdict.PASSED) >= 2


@pytest.mark.slow
def test_demonstrations_become_a_policy_with_two_cameras(tmp_path):
    demos, weights = tmp_path / "demos", tmp_path / "mini"
    call("make_libero_demos.py", "libero_object/3", "--episodes", 2, "--batch", 2, "--out", demos)
    (folder,) = demos.glob("libero_object-3-*")
    steps, frames = np.load(folder / "steps.npz"), np.load(folder / "frames.npy")
    assert frames.shape == (len(steps["label"]), 128, 128, 6)
    assert ((steps["pixels"] > 0) & (steps["pixels"] < 1)).all()
    assert steps["taught"].all()
    call("train_mini.py", demos, "--out", weights, "--updates", 2, "--batch", 8, "--every", 2)
    assert json.loads((weights / "policy.json").read_text())["views"] == 2
    assert [camera.role for camera in Mini(weights).spec.cameras] == ["third_person", "wrist"]
