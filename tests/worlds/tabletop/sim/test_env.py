"""The environment builds the requested scene and reports what it has built."""

from dataclasses import replace

import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, pick_up, put, states_hash
from vlafuzz.errors import CatalogueError, SimulatorError
from vlafuzz.model.scene import Camera, Light, Placement
from vlafuzz.worlds.tabletop.sim.objects import models_of

SHOWN = pick_up(
    put("orange", -0.10, 0.15, 30.0),
    put("coke_can", 0.05, -0.2, -70.0, "lying"),
    light=0.4,
    camera=Camera(0.04, 30.0, 20.0, roll=2.0, pitch=-3.0, yaw=4.0),
)


@pytest.mark.parametrize(
    ("requested", "says"),
    [
        (replace(SHOWN, light=Light(0.41)), "light"),
        (replace(SHOWN, instruction="pick up the orange"), "instruction"),
        (replace(SHOWN, camera=replace(SHOWN.camera, distance=0.041)), "pose of camera"),
        (replace(SHOWN, camera=replace(SHOWN.camera, roll=2.1)), "pose of camera"),
        (replace(SHOWN, targets=(put("orange", -0.099, 0.15, 30.0),)), "pose of orange"),
        (replace(SHOWN, confounders=(put("coke_can", 0.05, -0.2, -69.0, "lying"),)), "pose of coke_can"),
        (replace(SHOWN, confounders=(put("coke_can", 0.05, -0.2, -70.0),)), "pose of coke_can"),
        (replace(SHOWN, confounders=(put("pepsi_can", 0.05, -0.2, -70.0, "lying"),)), "objects"),
        (replace(SHOWN, confounders=()), "objects"),
    ],
)
def test_whatever_was_not_applied_is_an_error_that_names_it(env, requested, says):
    env.begin(SHOWN)
    env.applied().check(SHOWN, env.models, env.rig)
    models = models_of(requested.placements, CATALOGUE)
    with pytest.raises(SimulatorError, match=f"^{says}: asked for "):
        env.applied().check(requested, models, env.rig)


def test_an_objects_own_quaternion_and_scale_are_applied(env):
    tilted = (0.9, 0.0, 0.43589, 0.0)
    scene = pick_up(put("coke_can", -0.1, 0.1, quaternion=tilted), put("sponge", 0.05, -0.1, scale=0.5))
    env.begin(scene)
    can, sponge = env.applied().poses
    assert can.q == pytest.approx(tilted, abs=1e-4)
    assert sponge.p[2] == pytest.approx(0.009, abs=1e-5)


@pytest.mark.parametrize("broken", [Placement("orange", "standing", 0.0, 0.1), Placement("banana", "lying", 0.0, 0.1)])
def test_after_a_scene_that_cannot_be_built_the_next_one_is_as_ever(env, broken):
    known = states_hash(env)
    with pytest.raises(CatalogueError):
        env.begin(replace(CROWD, confounders=(*CROWD.confounders[:2], broken)))
    assert states_hash(env) == known
