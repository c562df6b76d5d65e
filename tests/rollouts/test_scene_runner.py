"""A runner rolls out policy and expert in the scenes of a store, and films them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.doubles import manifest
from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.model import Verdict
from vlafuzz.model.scene import CameraBump
from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.controls import Frozen
from vlafuzz.rollouts import setup
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import FILM_SPEED, Film
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

SEEDS: list[int] = []
BATCHES: list[int] = []


class Dice(Frozen):
    """Never moves, says that it is stochastic, and notes its seeds."""

    def __init__(self) -> None:
        self.spec = PolicySpec("dice", deterministic=False)

    def reset(self, episodes):
        SEEDS.extend(episode.seed for episode in episodes)


class Remote(Dice):
    """As behind a server that takes four observations at once."""

    answers_batches = True

    def __init__(self) -> None:
        self.spec = PolicySpec("remote", deterministic=False, max_batch=4)

    def act(self, observations):
        BATCHES.append(len(observations))
        return super().act(observations)


def make_remote(**_):
    return Remote()


def make_dice(**_):
    return Dice()


def make_frozen(**_):
    policy = Frozen()
    policy.reset = lambda episodes: SEEDS.extend(episode.seed for episode in episodes)
    return policy


def run(factory: str, **changes: object) -> Manifest:
    operators = load_operators().conditions["operators"]
    return manifest(policy=f"python:tests.rollouts.test_scene_runner:{factory}", seed=7, operators=operators, **changes)


@pytest.fixture(autouse=True)
def trusted():
    with trusting(EVERYTHING):
        yield


@pytest.mark.parametrize(
    ("factory", "repeats", "seeds", "deterministic"),
    [("make_dice", 1, [8, 10], False), ("make_frozen", 3, [10, 12], False), ("make_frozen", 1, [7, 9], True)],
)
def test_a_stochastic_policy_gets_seeds_that_its_run_did_not_have(factory, repeats, seeds, deterministic):
    SEEDS.clear()
    runner = SimulatorSceneRunner(Path("a.db"), run(factory, repeats=repeats))
    for number in (0, 2):
        (outcome,) = runner.evaluate([nominal()], [number])
        assert outcome.verdict is Verdict.FAILED
    runner.close()
    assert (seeds, runner.deterministic) == (SEEDS, deterministic)


def test_behind_a_server_scenes_are_rolled_out_at_the_same_time_each_with_its_seed():
    SEEDS.clear()
    BATCHES.clear()
    runner = SimulatorSceneRunner(Path("a.db"), run("make_remote"))
    outcomes = runner.evaluate([nominal()] * 5, [0, 1, 2, 3, 6])
    runner.close()
    assert [outcome.verdict for outcome in outcomes] == [Verdict.FAILED] * 5
    assert (SEEDS, set(BATCHES)) == ([8, 9, 10, 11, 14], {4, 1})


def test_the_expert_solves_a_scene_and_its_actions_do_it_again():
    runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen"))
    solved = runner.solve(nominal(), 0)
    played = [runner.play(nominal(), solved.rollouts[0].actions) for _ in range(2)]
    runner.close()
    assert [each.verdict for each in (solved, *played)] == [Verdict.PASSED] * 3
    assert played[0].rollouts[0].states_hash == played[1].rollouts[0].states_hash


def test_it_names_what_changed_since_the_run():
    here = setup.here(run("make_frozen").policy, Frozen(), SearchSpace(load_operators(), CATALOGUE, "pick-up"))
    of_users_code = {"source": "of a module that has changed since"}
    for changes, expected in (({}, ()), ({"commit": "other"}, ("commit",)), (of_users_code, ("source",))):
        runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen", **(here | changes)))
        runner.close()
        assert runner.changed == expected


@pytest.mark.render
def test_a_film_shows_the_scene_the_failure_and_what_the_witness_does(tmp_path: Path):
    runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen"))
    solved = runner.solve(nominal(), 0)
    films = [runner.film(nominal(), actions) for actions in (solved.rollouts[0].actions, None)]
    runner.close()
    solution, failure = (frames_of(film, tmp_path) for film in films if film is not None)
    assert [film.failed for film in films if film is not None] == [False, True]
    assert np.abs(failure[0] - failure[-1]).mean() < 2  # it never moves
    assert np.abs(solution[0] - solution[-1]).mean() > 3
    assert np.abs(failure[0] - solution[0]).mean() < 2  # the very same scene
    assert len(failure) > len(solution)
    ways = [np.array(film.paths[0][1]) / film.size for film in films]
    assert [len(way) for way in ways] == [film.frames for film in films]
    assert np.ptp(ways[1], axis=0).max() < 0.02  # of a picture
    assert np.ptp(ways[0], axis=0).max() > 0.05
    assert all(((way > 0) & (way < 1)).all() for way in ways)


@pytest.mark.render
def test_the_hand_s_path_is_drawn_anew_as_a_camera_shows_it_that_was_turned_meanwhile():
    runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen"))
    film = runner.film(replace(nominal(), camera_bump=CameraBump("start", yaw=5.0)))
    runner.close()
    (first, before), (turned, after) = film.paths
    assert (first, turned) == (0, 6)  # five frames a second; a second after the start
    shift = np.array(after[0]) - before[0]
    assert abs(shift[0]) > 0.05 * film.size[0]


def test_a_film_ends_with_the_last_state_whatever_its_pace():
    recording = Recording(8, stride=5)
    for steps in range(13):
        picture = np.full((8, 8, 3), steps)
        recording.note(
            SimpleNamespace(actions=[0] * steps, over=steps == 12, picture=lambda _, p=picture: p, sight=lambda: None)
        )
    assert [frame.max() for frame in recording.frames] == [0, 5, 10, 12]
    assert [recording.frame_after(steps) for steps in (0, 1, 5, 12)] == [0, 1, 1, 3]


def frames_of(film: Film, folder: Path) -> np.ndarray:
    """Its frames, as numbers that can be subtracted."""
    (folder / "film.mp4").write_bytes(film.video)
    video = cv2.VideoCapture(str(folder / "film.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 5 * FILM_SPEED
    frames = [frame for read, frame in iter(video.read, (False, None)) if read]
    video.release()
    assert cv2.imdecode(np.frombuffer(film.still, np.uint8), cv2.IMREAD_COLOR).shape == frames[0].shape
    return np.array(frames, dtype=float)
