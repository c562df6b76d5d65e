"""Actions that are executed late."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.errors import SimulatorError
from vlafuzz.model.scene import Latency
from vlafuzz.worlds.latency import DelayedCommands
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv, make_env

FORWARD = np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def env() -> Iterator[TabletopEnv]:
    env = make_env("pick-up", CATALOGUE)
    yield env
    env.close()


def reached(env: TabletopEnv, delay: int, steps: int = 6) -> list[float]:
    """How far the hand has come along x after each of some equal steps, metres."""
    scene = replace(nominal(), latency=Latency(delay))
    start = env.begin(scene).tcp[0]
    env.applied().check(scene, env.poses, env.rig)
    return [float(env.advance(FORWARD).tcp[0] - start) for _ in range(steps)]


@pytest.mark.parametrize("delay", [1, 3])
def test_the_robot_holds_still_until_the_first_action_arrives_and_then_does_the_same(env, delay):
    prompt, late = reached(env, 0), reached(env, delay)
    assert late[:delay] == pytest.approx([0.0] * delay, abs=1e-4)
    assert late[delay:] == pytest.approx(prompt[:-delay], abs=1e-3)


def test_without_delay_the_trajectory_is_the_one_of_a_scene_without_latency(env):
    hashes = []
    for scene in (nominal(), replace(nominal(), latency=Latency(0))):
        env.begin(scene)
        for _ in range(3):
            env.advance(FORWARD)
        hashes.append(env.world.states_hash)
    assert hashes[0] == hashes[1]


def test_a_delay_that_is_not_applied_is_noticed(env):
    env.begin(nominal())
    with pytest.raises(SimulatorError, match=r"latency: asked for .*delay=2.*, the simulator has .*delay=0"):
        env.applied().check(replace(nominal(), latency=Latency(2)), env.poses, env.rig)


def test_reset_echoes_the_delay(env):
    _, info = env.reset(options={"scene": replace(nominal(), latency=Latency(2))})
    assert info["applied"]["latency"] == {"delay": 2}


def test_a_command_is_exchanged_for_the_one_that_arrives():
    commands = DelayedCommands(Latency(1))
    first, second = FORWARD, 2 * FORWARD
    assert commands.exchange(first, "current")[1] == "target"
    assert commands.exchange(second, "current")[0] is first
