"""A corpus rolled out with nothing but gymnasium: as one environment, or as several side by side."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.folder import read_corpus

ID = "vlafuzz.exports.gym:vlafuzz/Corpus-v0"
STAY = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
UP = [0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0]
STEPS = 80  # of an episode that does not succeed


def make(corpus: Path, count: int, **more: object) -> VectorEnv:
    return gymnasium.make_vec(ID, num_envs=count, corpus=corpus, **{"size": 0} | more)


def witness(corpus: Path) -> np.ndarray:
    return read_corpus(corpus).cases[0].witness.actions.astype(np.float64)


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


def test_cases_are_spread_over_the_environments_and_a_seed_begins_again(corpus: Path):
    envs = make(corpus, 3)
    shown = [envs.reset()[1]["case"].tolist() for _ in range(2)]
    assert [*shown, envs.reset(seed=7)[1]["case"].tolist()] == [[0, 1, 0], [1, 0, 1], [0, 1, 0]]
    observation, info = envs.reset(options={"case": 1})
    assert info["case"].tolist() == [1, 1, 1]
    assert envs.observation_space.contains(observation)
    assert envs.action_space.contains(np.array([STAY] * 3))
    envs.close()


def test_each_goes_through_what_it_would_alone(corpus: Path):
    envs, alone = make(corpus, 2), gymnasium.make(ID, corpus=corpus, size=0)
    envs.reset(seed=0)
    together = [envs.step(np.array([action, action])) for action in witness(corpus)[:10]]
    for number in range(2):
        alone.reset(options={"case": number})
        for action, (seen, rewards, *_) in zip(witness(corpus), together, strict=False):
            state, reward, *_ = alone.step(action)
            assert np.array_equal(seen["state"][number], state["state"])
            assert (seen["instruction"][number], rewards[number]) == (state["instruction"], reward)
    envs.close()
    alone.close()


def test_after_an_episode_the_next_step_begins_one(corpus: Path):
    envs = RecordEpisodeStatistics(make(corpus, 2))
    envs.reset()
    for action in witness(corpus):
        _, rewards, ended, late, info = envs.step(np.array([action, STAY]))
        if ended.any():
            break
    assert (ended.tolist(), late.tolist()) == ([True, False], [False, False])
    assert info["success"].tolist() == [True, False]
    assert info["episode"]["r"][0] == pytest.approx(1.0, abs=0.02)
    observation, rewards, ended, late, info = envs.step(np.array([STAY, STAY]))
    assert (rewards[0], ended.any(), late.any()) == (0.0, False, False)
    assert (info["case"][0], info["_case"].tolist()) == (0, [True, False])  # two cases on, of two
    start = make(corpus, 1).reset()[0]
    assert np.array_equal(observation["state"][0], start["state"][0])
    envs.close()


def test_or_the_same_step_does(corpus: Path):
    envs = make(corpus, 1, autoreset_mode=AutoresetMode.SAME_STEP)
    begun = envs.reset()[0]
    for _ in range(STEPS):
        observation, _, _, late, info = envs.step(np.array([UP]))
    assert late.tolist() == [True]
    assert info["case"].tolist() == [1]
    assert info["final_obs"][0]["state"][2] > 0.3
    assert np.array_equal(observation["state"], begun["state"])  # another scene, the same robot
    envs.close()


@pytest.mark.slow
@pytest.mark.render
def test_processes_of_their_own_make_no_difference(corpus: Path):
    observations = []
    for processes in (False, True):
        envs = make(corpus, 2, size=32, processes=processes)
        first, _ = envs.reset(seed=0)
        seen = [first, *(envs.step(np.array([action, STAY]))[0] for action in witness(corpus)[:5])]
        observations.append(seen)
        envs.close()
    for here, there in zip(*observations, strict=True):
        assert here["instruction"] == there["instruction"]
        assert np.array_equal(here["state"], there["state"])
        assert np.array_equal(here["image"], there["image"])
