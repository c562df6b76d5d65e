"""From LIBERO's expert to a trained policy: demonstrations, and what the shipped weights do."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Verdict
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.libero.space import nominal_scene

pytestmark = pytest.mark.libero
SCRIPTS = Path(__file__).parents[3] / "scripts"


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
