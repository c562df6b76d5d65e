"""Arms that are bent a little at the start."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.errors import SimulatorError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import InitialPose, Scene
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv, make_env

STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
BENT = InitialPose(j1=3.0, j2=-2.0, j4=1.5, j7=-1.0)


def bent(pose: InitialPose) -> Scene:
    return replace(nominal(), initial_pose=pose)


@pytest.fixture(scope="module")
def env() -> Iterator[TabletopEnv]:
    made = make_env("pick-up", CATALOGUE)
    yield made
    made.close()


def test_the_first_joint_turns_the_hand_about_the_base(env):
    base = np.array(env.rig.base)
    straight = env.begin(nominal()).tcp - base
    turned = env.begin(bent(InitialPose(j1=3.0))).tcp - base
    angle = np.degrees(np.arctan2(turned[1], turned[0]) - np.arctan2(straight[1], straight[0]))
    assert angle == pytest.approx(3.0, abs=0.01)
    assert turned[2] == pytest.approx(straight[2], abs=1e-4)


def test_the_arm_stays_where_it_starts(env):
    start = env.begin(bent(BENT)).tcp
    for _ in range(3):
        state = env.advance(STILL)
    assert state.tcp == pytest.approx(start, abs=1e-3)


def test_a_pose_does_not_last_beyond_its_scene(env):
    before = env.begin(nominal())
    env.begin(bent(BENT))
    assert np.array_equal(env.begin(nominal()).tcp, before.tcp)


def test_the_pose_is_read_back_from_the_simulator(env):
    _, info = env.reset(options={"scene": bent(BENT)})
    assert info["applied"]["initial_pose"]["j2"] == pytest.approx(-2.0, abs=1e-4)
    with pytest.raises(SimulatorError, match="initial pose: asked for"):
        env.applied().check(nominal(), env.poses, env.rig)


def test_the_expert_solves_the_task_from_a_bent_start(expert_on):
    (outcome,) = expert_on("pick-up").evaluate([bent(BENT)])
    assert outcome.verdict is Verdict.PASSED
