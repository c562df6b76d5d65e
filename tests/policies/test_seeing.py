"""The seeing expert solves by what the camera shows, through any camera and in any light that it knows."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, evaluate, nominal, pick_up, put
from vlafuzz.errors import PolicyError
from vlafuzz.model import Camera, Conditions, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.worlds.manipulation.arms import hand_boxes
from vlafuzz.worlds.tabletop.evaluator import outlines
from vlafuzz.worlds.tabletop.experts.expert import Calibration
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole
from vlafuzz.worlds.tabletop.experts.seeing import Look, SeeingExpert
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

DISPLACED = Camera(distance=0.05, azimuth=90.0, yaw=4.0, roll=-3.0)
CANS = (put("coke_can", 0.0, 0.2), put("sprite_can", 0.05, -0.2), put("7up_can", -0.18, -0.2))


def verdict(scene, policy=SeeingExpert):
    return evaluate(policy(), scene, world={"min_distance": 0.0})[0].verdict


@pytest.mark.parametrize("task", TASKS)
def test_it_solves_every_task_through_a_displaced_camera(task):
    assert verdict(replace(nominal(task), camera=DISPLACED)) is Verdict.PASSED


@pytest.mark.parametrize(
    "scene",
    [
        nominal(),
        replace(nominal(), camera=Camera(yaw=8.0)),
        replace(nominal(), camera=Camera(distance=0.25, azimuth=90.0)),
        pick_up(put("redbull_can", -0.05, 0.0), light=4.0),
        pick_up(put("apple", -0.05, 0.0), put("orange", 0.0, 0.2), put("coke_can", 0.05, -0.2), light=6.0),
    ],
    ids=["nominal", "turned", "displaced", "white in white", "much alike"],
)
def test_camera_and_light_that_defeat_pinhole_do_not_defeat_it(scene):
    assert verdict(scene) is Verdict.PASSED
    assert (verdict(scene, Pinhole) is Verdict.PASSED) == (scene == nominal())


def test_in_darkness_it_tells_cans_apart():
    assert verdict(pick_up(put("pepsi_can", -0.05, 0.0), *CANS, light=0.05)) is Verdict.PASSED


def test_it_takes_what_the_instruction_means_whatever_its_words():
    scene = pick_up(put("orange", -0.05, 0.0), *CANS)
    assert verdict(replace(scene, instruction="grab the round fruit")) is Verdict.PASSED


def test_it_moves_around_what_stands_in_its_way():
    targets, tall = (put("green_cube", -0.05, -0.18), put("apple", -0.05, 0.18)), put("pepsi_can", -0.05, 0.0)
    scene = replace(nominal("move-near"), targets=targets, confounders=(tall,))
    policy = SeeingExpert()
    with closing(ManiSkillEvaluator(Conditions(task="move-near"), policy, CATALOGUE)) as evaluator:
        episode = evaluator.begin(scene, 0)
        before = obstacle(episode.observe().outlines)
        policy.reset([episode.start])
        while not episode.monitor.success_once:
            episode.advance(policy.act([episode.observe()])[0].actions[0])
        assert len(episode.actions) < 40
        assert np.allclose(obstacle(episode.observe().outlines), before, atol=0.01)


def obstacle(seen):
    """The middle of the bluest outline."""
    return max(seen.things, key=lambda thing: thing.colour[2]).pixels.mean(axis=0)


def test_it_asks_for_no_state_of_the_simulator_and_refuses_without_calibration():
    seeing = SeeingExpert()
    assert (seeing.spec.privileged, seeing.spec.cameras, seeing.spec.deterministic) == (False, (), True)
    seeing.reset([EpisodeStart("one", "pick up apple", "pick-up", 0)])
    with pytest.raises(PolicyError, match="needs outlines, proprioception and calibration"):
        seeing.act([Observation("one", 0, "pick up apple")])


@pytest.mark.parametrize("name", ["pepsi_can", "carrot", "sponge", "spoon", "blue_plastic_bottle", "basket"])
def test_a_fit_finds_place_and_rest_pose_although_something_stands_before_it(env, name):
    for rest in CATALOGUE[name].stable_poses:
        target, before = put(name, -0.1, -0.1, 40.0, rest.name), put("orange", 0.02, -0.07)
        state = env.begin(pick_up(target, before, camera=DISPLACED))
        seen = outlines(env.models, state, env.view, env.light)
        hand = hand_boxes(state.tcp, state.tcp_rotation, state.opening)
        look = Look(seen, Calibration(env.view, env.light, env.models[:1]), hand)
        thing = look.find(CATALOGUE[name], look.alike(CATALOGUE[name], look.colours))
        assert np.linalg.norm(thing.position - state.positions[0]) < 0.004


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_it_solves_nearly_all_random_scenes_that_are_seen(task):
    operators = load_operators()
    space = SearchSpace(operators, CATALOGUE, task)
    world = operators.conditions["world"]
    with closing(ManiSkillEvaluator(Conditions(task=task, world=world), SeeingExpert(), CATALOGUE)) as evaluator:
        scenes = [space.sample(np.random.default_rng([1, number])) for number in range(60)]
        verdicts = [outcome.verdict for outcome in evaluator.evaluate(scenes)]
    judged = [verdict for verdict in verdicts if verdict is not Verdict.INVALID]
    assert len(judged) >= 55
    assert judged.count(Verdict.PASSED) >= 0.95 * len(judged)
