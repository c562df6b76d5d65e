"""The pinhole fails for physical reasons, and for no others."""

import dataclasses

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, evaluate, nominal
from vlafuzz.model import Camera, Light, Placement, Scene, Verdict
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole, _named
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue

SCENE = nominal("pick-up")
SPOON = {"targets": (Placement("spoon", "lying", -0.05, 0.0),), "instruction": "pick up spoon"}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, Verdict.PASSED),
        ({"camera": Camera(yaw=8.0)}, Verdict.FAILED),
        ({"camera": Camera(yaw=-8.0)}, Verdict.FAILED),
        ({"camera": Camera(distance=0.25, azimuth=90.0)}, Verdict.FAILED),
        ({"light": Light(20.0)}, Verdict.PASSED),  # a pepsi can is blue: red stays below white
        (SPOON, Verdict.PASSED),
        (SPOON | {"light": Light(20.0)}, Verdict.FAILED),
    ],
)
def test_a_camera_that_is_moved_and_glare_make_it_miss(changes, expected):
    (outcome,) = evaluate(Pinhole(), dataclasses.replace(SCENE, **changes))
    assert outcome.verdict is expected


def test_a_wording_that_names_the_objects_in_another_order_swaps_them():
    models = [load_catalogue()[name] for name in load_catalogue().names()]
    assert [model.name for model in _named("put apple on large plate", models)] == ["apple", "large_plate"]
    assert [model.name for model in _named("let the plate carry the apple", models)] == ["plate", "apple"]


def test_to_mix_up_what_goes_into_what_is_a_failure_and_no_error():
    around = (
        Placement("sprite_can", "standing", 0.023, -0.066),
        Placement("blue_plastic_bottle", "standing", 0.01, 0.021),
        Placement("apple", "resting", -0.071, 0.008, -51.0),
    )
    targets = (Placement("eggplant", "lying", -0.058, -0.048, -19.0), Placement("basket", "flat", -0.05, 0.18, 158.0))
    scene = Scene("put-in", targets, "fill the basket with the eggplant", confounders=around)
    (mixed_up,) = evaluate(Pinhole(), scene, world={"min_distance": 0.0})
    assert (mixed_up.verdict, mixed_up.detail) == (Verdict.FAILED, "")


@pytest.mark.parametrize("name", ["pepsi_can", "carrot", "sponge", "green_cube", "blue_plastic_bottle"])
@pytest.mark.parametrize("yaw", [0.0, 40.0, 110.0])
def test_its_eyes_find_place_rest_pose_and_yaw(env, name, yaw):
    from vlafuzz.worlds.manipulation.camera import camera_pose
    from vlafuzz.worlds.manipulation.rigs import PANDA
    from vlafuzz.worlds.tabletop.evaluator import outlines
    from vlafuzz.worlds.tabletop.experts.pinhole import OutlineLocalizer

    model = CATALOGUE[name]
    for rest in model.stable_poses:
        scene = dataclasses.replace(SCENE, targets=(Placement(name, rest.name, 0.05, -0.18, yaw),))
        state = env.begin(scene)
        seen = outlines(env.models, state, env.view, 1.0)
        thing = OutlineLocalizer(camera_pose(PANDA.view)).find(model, seen)
        assert np.linalg.norm(thing.position[:2] - [0.05, -0.18]) < 0.008
        assert abs(thing.position[2] - rest.height) < 0.005
