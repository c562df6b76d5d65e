"""The picture that fairness is judged by, computed without a renderer, is the one that is rendered."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, make_env, pick_up, put
from vlafuzz.model.scene import Camera, InitialPose
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.manipulation import arms
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.fairness.visible import Picture
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv

SIZE = 256
SCENES = {
    "nominal": pick_up(put("coke_can", 0.0, 0.0)),
    "dark": pick_up(put("orange", -0.1, 0.1), light=0.06),
    "bright": pick_up(put("carrot", 0.05, -0.1, 40.0), light=5.0),
    "behind the hand": pick_up(put("sprite_can", -0.18, -0.02)),
    "behind a bottle": pick_up(put("apple", -0.13, 0.0), put("blue_plastic_bottle", 0.02, 0.0)),
    "another view": pick_up(put("plate", 0.0, 0.1), camera=Camera(0.05, 135, -30, roll=-4, pitch=3, yaw=-5)),
}


@pytest.fixture(scope="module")
def seeing() -> TabletopEnv:
    env = make_env(cameras=(CameraRequest("front", SIZE, SIZE),))
    yield env
    env.close()


@pytest.mark.render
@pytest.mark.parametrize("name", SCENES)
def test_an_object_covers_as_much_of_both_pictures_and_has_the_same_colour(seeing: TabletopEnv, name: str):
    scene = SCENES[name]
    seeing.begin(scene)
    rendered = seeing.picture("front")
    numbers = seeing._render_camera("front").get_picture("PositionSegmentation")[..., 3]
    bodies = {entity.name: entity.per_scene_id for entity in seeing.world.scene.entities}
    target = rendered[numbers == bodies[f"0-{scene.targets[0].object}"]]
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
