"""Demonstrations in LIBERO's scenes, as the policies of its models would have to act."""

from dataclasses import replace

import numpy as np
import pytest

from tests.exports.test_demonstrations import of_policy
from vlafuzz.exports.expert_runner import ExpertRunner
from vlafuzz.model.scene import Light
from vlafuzz.worlds.libero.space import nominal_scene

pytestmark = pytest.mark.libero


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
    solution = runner.solve(scene)
    shown = runner.record(scene, solution.actions)
    names = tuple(runner.interface.state_names[6:])
    runner.close()
    assert solution.attempt is not None
    assert names == layout
    assert shown.states.shape == (len(shown.actions), 6 + len(layout))
    assert least < len(shown.actions) < 4 * least
    assert all(len(pictures) == len(shown.actions) for pictures in shown.images.values())
    assert set(np.sign(shown.actions[:, -1])) == {-1.0, 1.0}
