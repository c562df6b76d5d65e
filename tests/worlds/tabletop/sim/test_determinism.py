"""The same scene gives the same trajectory, bit by bit, whatever was simulated before it and wherever."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import (
    CROWD,
    EVENTFUL,
    STILL,
    make_env,
    nominal,
    play,
    pushes,
    random_scene,
    states_hash,
)
from vlafuzz.policies.base import CameraRequest

# No Vulkan driver is found in it; an expert's rollouts, one with events, and a trajectory in contact, each as its hash.
CHILD = """
import json
from tests.worlds.tabletop.sim.scenes import EVENTFUL, evaluate, make_env, nominal, states_hash
from vlafuzz.worlds.tabletop.experts.expert import Expert
outcomes = evaluate(Expert(), nominal(), EVENTFUL)
hashes = [rollout.states_hash for outcome in outcomes for rollout in outcome.rollouts]
print(json.dumps([states_hash(make_env()), *(outcome.verdict.name for outcome in outcomes), *hashes]))
"""


@pytest.fixture(scope="module")
def fresh() -> str:
    """Of a trajectory in contact, in an environment that has seen nothing else."""
    env = make_env()
    yield states_hash(env)
    env.close()


def test_a_used_environment_repeats_what_a_fresh_one_does(env, fresh):
    rng = np.random.default_rng(0)
    for number in range(25):
        states_hash(env, random_scene(rng))
        if number % 5 == 0:
            assert states_hash(env) == fresh


def test_a_full_rebuild_repeats_it_and_so_does_what_comes_after_it(env, fresh):
    env.reset(options={"reconfigure": True})
    env.begin(CROWD)
    play(env, pushes())
    assert env.world.states_hash.hexdigest() == states_hash(env) == fresh


def test_a_scene_cut_short_leaves_no_trace_and_another_action_another_hash(env, fresh):
    start = env.begin(CROWD)
    end = play(env, [*pushes()[:-1], STILL])
    assert (np.linalg.norm(end.positions - start.positions, axis=1) > 0.01).sum() >= 3
    assert env.world.states_hash.hexdigest() != fresh
    env.begin(CROWD)
    play(env, [[0, 0, -0.14, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, -1]])
    assert states_hash(env) == fresh


def test_another_process_without_vulkan_repeats_it_and_the_experts_rollout(fresh, expert_on):
    nowhere = {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}
    command, environment = [sys.executable, "-c", CHILD], os.environ | nowhere
    child = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
    hashes = [one.rollouts[0].states_hash for one in expert_on("pick-up").evaluate([nominal(), EVENTFUL])]
    assert json.loads(child.stdout.splitlines()[-1]) == [fresh, "PASSED", "PASSED", *hashes]


@pytest.mark.render
def test_a_renderer_changes_nothing(fresh):
    env = make_env(cameras=(CameraRequest("front", 64, 64),))
    hashes = []
    for pictures in (0, 3):
        env.begin(CROWD)
        for number, action in enumerate(pushes()):
            env.advance(action)
            if number < pictures:
                env.picture("front")
        hashes.append(env.world.states_hash.hexdigest())
    env.close()
    assert hashes == [fresh, fresh]
