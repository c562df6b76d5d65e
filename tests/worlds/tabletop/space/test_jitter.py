"""Jitter: the scenes around a scene."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.model import Scene
from vlafuzz.worlds.manipulation import jitter
from vlafuzz.worlds.manipulation.jitter import jittered
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

SPACE = SearchSpace(load_operators(), load_catalogue(), "put-on")
SCENE = SPACE.sample(np.random.default_rng(3))


def around(scene: Scene, count: int = 200) -> list[Scene]:
    return [jittered(scene, number) for number in range(count)]


def test_the_same_number_gives_the_same_scene_and_another_one_another():
    scenes = around(SCENE)
    assert scenes == around(SCENE)
    assert len(set(scenes)) == len(scenes)
    assert jittered(replace(SCENE, instruction="other"), 0) != scenes[0]


def test_no_value_moves_further_than_it_may_and_some_nearly_so_far():
    scenes = around(SCENE)
    placed = zip(*(scene.placements for scene in scenes), strict=True)
    for usual, moved in zip(SCENE.placements, placed, strict=True):
        for name, most in (("x", jitter.POSITION), ("y", jitter.POSITION), ("yaw", jitter.YAW)):
            farthest = max(abs(getattr(placement, name) - getattr(usual, name)) for placement in moved)
            assert 0.9 * most < farthest <= most * 1.000001
    shift = [np.subtract(scene.camera.offset, SCENE.camera.offset) for scene in scenes]
    assert 0.9 * jitter.CAMERA_POSITION < np.abs(shift).max() <= jitter.CAMERA_POSITION * 1.000001
    turned = [abs(scene.camera.roll - SCENE.camera.roll) for scene in scenes]
    assert 0.9 * jitter.CAMERA_ORIENTATION < max(turned) <= jitter.CAMERA_ORIENTATION * 1.000001
    lights = [scene.light.intensity / SCENE.light.intensity - 1 for scene in scenes]
    assert 0.9 * jitter.LIGHT < np.abs(lights).max() <= jitter.LIGHT * 1.000001
    joints = [abs(scene.initial_pose.j7) for scene in scenes]
    assert 0.9 * jitter.JOINTS < max(joints) <= jitter.JOINTS * 1.000001


def test_what_makes_it_another_scene_is_kept():
    for scene in around(SCENE, 20):
        names = [[placed.object for placed in one.placements] for one in (scene, SCENE)]
        assert names[0] == names[1]
        assert (scene.task, scene.instruction, scene.robot) == (SCENE.task, SCENE.instruction, SCENE.robot)
        assert scene.noise.grain == pytest.approx(np.hypot(SCENE.noise.grain, jitter.PIXEL_NOISE))


def test_an_imported_object_is_turned_about_the_vertical():
    lying = (0.5, 0.5, 0.5, 0.5)
    scene = replace(SCENE, targets=tuple(replace(target, quaternion=lying) for target in SCENE.targets))
    turned = [Rotation.from_quat(near.targets[0].quaternion, scalar_first=True) for near in around(scene)]
    usual = Rotation.from_quat(lying, scalar_first=True)
    turns = np.degrees([(rotation * usual.inv()).as_rotvec() for rotation in turned])
    assert np.abs(turns[:, :2]).max() < 1e-6
    assert 0.9 * jitter.YAW < np.abs(turns[:, 2]).max() <= jitter.YAW * 1.000001


def test_an_arm_of_six_joints_keeps_to_them():
    assert jittered(replace(SCENE, robot="widowx"), 0).initial_pose.j7 == 0
