"""The gymnasium environment: it builds the requested scene and reports what it has built."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, STILL, make_env, nominal, pick_up, put, states_hash
from vlafuzz.errors import CatalogueError, SceneError, SimulatorError
from vlafuzz.model.scene import Camera, Light, Placement
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import gym_id
from vlafuzz.worlds.tabletop.sim.objects import models_of
from vlafuzz.worlds.tabletop.tasks import TASKS, default_scene

SHOWN = pick_up(
    put("orange", -0.10, 0.15, 30.0),
    put("coke_can", 0.05, -0.2, -70.0, "lying"),
    light=0.4,
    camera=Camera(0.04, 30.0, 20.0, roll=2.0, pitch=-3.0, yaw=4.0),
)


@pytest.mark.parametrize("task", TASKS)
def test_every_task_has_an_environment_of_its_own_that_resets_without_options(task):
    env = make_env(task)
    _, info = env.reset()
    env.close()
    assert gym_id(task) in ("VlaFuzz-PickUp-v1", "VlaFuzz-MoveNear-v1", "VlaFuzz-PutOn-v1", "VlaFuzz-PutIn-v1")
    assert info["applied"]["instruction"] == nominal(task).instruction
    assert len(info["applied"]["objects"]) == TASKS[task].targets


@pytest.mark.parametrize("task", TASKS)
def test_the_default_scene_is_a_fair_one(task):
    assert check_static(default_scene(task, load_catalogue()), load_catalogue(), 0.15) is None


def test_a_step_gives_gymnasiums_five_things(env):
    env.reset(options={"scene": nominal()})
    observation, reward, terminated, truncated, info = env.step(STILL)
    assert observation is not None
    assert (float(reward), bool(terminated), bool(truncated)) == (0.0, False, False)
    assert not info["success"]
    assert 0 <= float(info["progress"]) < 1


def test_proprioception_comes_with_the_observation():
    env = make_env(obs_mode="state_dict")
    observation, _ = env.reset(options={"scene": nominal()})
    env.close()
    assert observation["extra"]["tcp_pose"].numpy()[0, :3] == pytest.approx([0.0, 0.0, 0.17], abs=0.001)


def test_reset_echoes_the_whole_scene(env):
    _, info = env.reset(options={"scene": SHOWN})
    applied = info["applied"]
    assert applied["instruction"] == "pick up orange"
    assert applied["light"] == 0.4
    assert [entry["name"] for entry in applied["objects"]] == ["orange", "coke_can"]
    assert applied["objects"][0]["position"] == pytest.approx([-0.10, 0.15, 0.0345], abs=1e-5)
    assert applied["camera"]["position"] == pytest.approx(env.view.position, abs=1e-6)


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
    env.reset(options={"scene": SHOWN})
    env.applied().check(SHOWN, env.models, env.rig)
    models = models_of(requested.placements, CATALOGUE)
    with pytest.raises(SimulatorError, match=f"^{says}: asked for "):
        env.applied().check(requested, models, env.rig)


def test_an_objects_own_quaternion_and_scale_are_applied(env):
    tilted = (0.9, 0.0, 0.43589, 0.0)
    scene = pick_up(put("coke_can", -0.1, 0.1, quaternion=tilted), put("sponge", 0.05, -0.1, scale=0.5))
    env.reset(options={"scene": scene})
    can, sponge = env.applied().poses
    assert can.q == pytest.approx(tilted, abs=1e-4)
    assert sponge.p[2] == pytest.approx(0.009, abs=1e-5)


@pytest.mark.parametrize("scene", ["{}", Placement("orange", "resting", 0.0, 0.0)], ids=repr)
def test_what_is_no_scene_is_refused(env, scene):
    with pytest.raises(SceneError, match=r"options\['scene'\]: expected a Scene"):
        env.reset(options={"scene": scene})


def test_a_scene_of_another_task_is_refused(env):
    with pytest.raises(SceneError, match="its task is 'put-in', this environment's is 'pick-up'"):
        env.reset(options={"scene": nominal("put-in")})


@pytest.mark.parametrize("broken", [Placement("orange", "standing", 0.0, 0.1), Placement("banana", "lying", 0.0, 0.1)])
def test_after_a_scene_that_cannot_be_built_the_next_one_is_as_ever(env, broken):
    known = states_hash(env)
    with pytest.raises(CatalogueError):
        env.reset(options={"scene": replace(CROWD, confounders=(*CROWD.confounders[:2], broken))})
    assert states_hash(env) == known


@pytest.mark.parametrize("bad", [[0, 0, np.nan, 0, 0, 0, 1.0], [0, 0, np.inf, 0, 0, 0, 1.0], [0.0] * 6])
def test_an_action_that_is_no_number_is_refused_before_it_reaches_the_robot(env, bad):
    env.reset(options={"scene": nominal()})
    with pytest.raises(ValueError, match="expected 7 finite numbers"):
        env.step(np.array(bad))
    env.step(STILL)
    assert np.isfinite(env.applied().poses[0].p).all()
