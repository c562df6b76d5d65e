"""Outlines show what the camera shows, and the picture that fairness computes what is rendered."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
import sapien

from tests.worlds.tabletop.sim.scenes import CATALOGUE, SIZE, make_env, pick_up, put
from vlafuzz.model import Camera, InitialPose
from vlafuzz.worlds.manipulation import arms
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.evaluator import outlines
from vlafuzz.worlds.tabletop.fairness.visible import Picture
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv


def see(env, *placements, light=1.0, camera=None):
    scene = pick_up(*placements, camera=camera or Camera())
    hand_away = dataclasses.replace(env.begin(scene), tcp=np.array([-0.3, 0.0, 0.6]))
    return outlines(env.models, hand_away, env.view, light)


def test_a_lone_object_is_seen_whole_where_the_camera_projects_it(env):
    seen = see(env, put("green_cube", 0.05, 0.1))
    (cube,) = seen.things
    expected, _ = env.view.project(np.array([[0.05, 0.1, 0.015]]))
    assert cube.whole > 0.95
    assert cube.pixels.mean(axis=0) == pytest.approx(expected[0], abs=0.006)


def test_an_object_behind_another_is_partly_hidden(env):
    seen = see(env, put("green_cube", -0.10, 0.0), put("coke_can", -0.03, 0.0))
    shares = sorted(thing.whole for thing in seen.things)
    assert len(shares) == 1 or shares[0] < 0.6
    assert shares[-1] > 0.95


def test_the_hand_hides_what_is_behind_it(env):
    start = env.begin(pick_up(put("green_cube", -0.30, 0.0)))
    assert not outlines(env.models, start, env.view, 1.0).things


def test_colours_scale_with_the_light_and_saturate(env):
    dim, nominal, glare = (see(env, put("orange", 0.05, 0.1), light=light).things[0].colour for light in (0.1, 1, 20))
    assert dim == pytest.approx(nominal * 0.1)
    assert glare.max() == 1.0


def test_an_object_cut_by_the_border_is_not_whole(env):
    seen = see(env, put("blue_plastic_bottle", 0.15, 0.3))
    assert not seen.things or seen.things[0].whole < 0.9


def test_the_order_of_things_tells_nothing_of_the_scene(env):
    view = see(env, put("orange", 0.0, 0.1), put("apple", 0.0, -0.1))
    other = see(env, put("apple", 0.0, -0.1), put("orange", 0.0, 0.1))
    colours = [[thing.colour.tolist() for thing in seen.things] for seen in (view, other)]
    assert colours[0] == colours[1]


SCENES = {
    "nominal": pick_up(put("coke_can", 0.0, 0.0)),
    "dark": pick_up(put("orange", -0.1, 0.1), light=0.06),
    "bright": pick_up(put("carrot", 0.05, -0.1, 40.0), light=5.0),
    "behind the hand": pick_up(put("sprite_can", -0.18, -0.02)),
    "behind a bottle": pick_up(put("apple", -0.13, 0.0), put("blue_plastic_bottle", 0.02, 0.0)),
    "another view": pick_up(put("plate", 0.0, 0.1), camera=Camera(0.05, 135, -30, roll=-4, pitch=3, yaw=-5)),
}


@pytest.mark.render
@pytest.mark.parametrize("name", SCENES)
def test_an_object_covers_as_much_of_both_pictures_and_has_the_same_colour(seeing: TabletopEnv, name: str):
    scene = SCENES[name]
    seeing.begin(scene)
    rendered = seeing.picture("front")
    seeing.world.put(0, sapien.Pose([0.0, 0.0, -5.0]))  # under the floor
    target = rendered[(rendered != seeing.picture("front")).any(axis=-1)]
    picture = Picture(scene, CATALOGUE)
    colours, areas = picture.colours(0)
    assert picture.hidden(0).area == pytest.approx(len(target) / SIZE**2, rel=0.25, abs=0.0005)
    assert np.average(colours, axis=0, weights=areas) == pytest.approx(target.mean(axis=0), abs=14)


@pytest.mark.parametrize("pose", [InitialPose(), InitialPose(j1=20.0, j2=-8.0, j4=5.0, j6=-10.0)])
def test_the_fingers_are_where_the_simulator_has_them(pose: InitialPose):
    env = make_env()
    start = env.begin(replace(SCENES["nominal"], initial_pose=pose))
    tips = [body[body[:, 2].argmin()] for body in arms.bodies(PANDA, pose)[-2:]]
    assert np.mean(tips, axis=0) == pytest.approx(start.tcp, abs=0.02)
    env.close()
