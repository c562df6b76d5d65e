"""A corpus rolled out with nothing but gymnasium: as one environment, or as several side by side."""

from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.errors import UsageError

ID = "vlafuzz.exports.gym:vlafuzz/Corpus-v0"


def test_a_witness_solves_its_scene_and_every_gain_in_progress_is_rewarded(corpus: Path):
    env = gymnasium.make(ID, corpus=corpus, size=0)
    observation, info = env.reset()
    assert (info["case"], observation["instruction"]) == (0, nominal().instruction)
    rewards, ended = 0.0, False
    for action in env.unwrapped.cases[0].witness.actions.astype(np.float64):
        _, reward, ended, truncated, info = env.step(action)
        rewards += reward
        if ended:
            break
    assert (ended, truncated, info["success"], info["reached"][0]) == (True, False, True, "grasp")
    assert rewards == pytest.approx(1.0, abs=0.02)
    env.close()


def test_scenes_follow_each_other_or_are_requested(corpus: Path):
    env = gymnasium.make(ID, corpus=corpus, size=0)
    seen = [env.reset()[1]["case"] for _ in range(3)]
    assert [*seen, env.reset(options={"case": 1})[1]["case"]] == [0, 1, 0, 1]
    with pytest.raises(UsageError, match=r"options\['case'\]: 2"):
        env.reset(options={"case": 2})
    with pytest.raises(UsageError, match="action"):
        env.unwrapped.step(np.full(7, np.nan))
    env.close()


def test_it_is_cut_off_after_sixteen_seconds(corpus: Path):
    env = gymnasium.make(ID, corpus=corpus, size=0)
    env.reset()
    ends = [env.step(np.array([0, 0, 0, 0, 0, 0, 1.0]))[2:4] for _ in range(80)]
    assert ends == [(False, False)] * 79 + [(False, True)]
    env.close()


@pytest.mark.render
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized:UserWarning")  # metres are metres
def test_it_is_an_environment_as_gymnasium_wants_it(corpus: Path):
    env = gymnasium.make(ID, corpus=corpus, size=64)
    check_env(env.unwrapped, skip_render_check=True)
    observation, _ = env.reset(options={"case": 0})
    assert observation["image"].shape == (64, 64, 3)
    assert observation["image"].std() > 10
    env.close()


def test_cases_are_spread_over_environments_side_by_side_and_a_seed_begins_again(corpus: Path):
    envs = SyncVectorEnv([partial(gymnasium.make, ID, corpus=corpus, size=0, first=n, every=3) for n in range(3)])
    shown = [envs.reset()[1]["case"].tolist() for _ in range(2)]
    assert [*shown, envs.reset(seed=7)[1]["case"].tolist()] == [[0, 1, 0], [1, 0, 1], [0, 1, 0]]
    observation, *_ = envs.step(np.array([[0.0] * 6 + [1.0]] * 3))
    assert envs.observation_space.contains(observation)
    envs.close()
