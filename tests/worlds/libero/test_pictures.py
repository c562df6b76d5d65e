"""Cheaper pictures beside LIBERO's own: similar, and the same whenever the state is the same."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.similarity import similarity
from vlafuzz.model import Camera, Light
from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures import CAMERAS, discard, shrink
from vlafuzz.worlds.libero.setting import Setting
from vlafuzz.worlds.libero.space import nominal_scene
from vlafuzz.worlds.libero.suites import find_task
from vlafuzz.worlds.libero.world import WORLD
from vlafuzz.worlds.provenance import here, in_words

pytestmark = pytest.mark.libero
TASK = "libero_goal/8"
MOST = 512  # pixels of a texture's side
REACH = np.array([0.5, 0.2, -0.6, 0.0, 0.0, 0.3, 1.0])


@pytest.fixture(scope="module")
def both() -> Iterator[list[LiberoEnv]]:
    """One with LIBERO's own pictures, and one with cheaper ones."""
    envs = [LiberoEnv(find_task(TASK), size=224, quality=quality) for quality in ("full", "fast")]
    yield envs
    for env in envs:
        env.close()


def reached(env: LiberoEnv, steps: int) -> None:
    env.reset(1)
    env.settle(10)
    for _ in range(steps):
        env.step(REACH)


def digest(env: LiberoEnv) -> str:
    pictures = env.pictures()
    return hashlib.sha256(b"".join(pictures[name].tobytes() for name in CAMERAS)).hexdigest()


@pytest.mark.parametrize("steps", [0, 12, 25])
def test_pictures_are_similar_to_liberos_own_also_where_the_arm_is_over_the_table(both, steps):
    for env in both:
        reached(env, steps)
    assert np.array_equal(*(env.state() for env in both))
    expected, cheaper = (env.pictures() for env in both)
    for camera in CAMERAS:
        assert 0.95 <= similarity(expected[camera], cheaper[camera]) < 1.0
    smaller = [env.picture("agentview", 96) for env in both]
    assert smaller[1].shape == (96, 96, 3)
    assert similarity(*smaller) > 0.9


def test_a_scene_with_other_light_and_camera_is_drawn_anew_and_leaves_nothing_behind(both):
    nominal, settings = nominal_scene(TASK, "libero"), [Setting(env) for env in both]
    settings[1].begin(nominal)
    before = digest(both[1])
    for setting in settings:
        setting.begin(replace(nominal, light=Light(0.4), camera=Camera(0.04, 90.0, 3.0)))
    assert similarity(*(env.pictures()["agentview"] for env in both)) >= 0.95
    for setting in settings:
        setting.begin(nominal)
    assert digest(both[1]) == before


def test_neither_what_was_drawn_before_nor_the_process_decides_a_picture(both):
    coarse = both[1]
    reached(coarse, 30)
    coarse.picture("agentview", 128)
    reached(coarse, 12)
    code = (
        "from tests.worlds.libero.test_pictures import *\n"
        "env = LiberoEnv(find_task(TASK), size=224, quality='fast')\n"
        "reached(env, 12)\n"
        "print(digest(env))"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.split()[-1] == digest(coarse)


CHECKER = """<mujoco><asset>
  <texture name="large" type="2d" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="2048" height="1024"/>
  <texture name="small" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>
</asset></mujoco>"""


def test_a_large_texture_becomes_the_mean_of_its_pixels_and_a_small_one_stays():
    model = load("mujoco").MjModel.from_xml_string(CHECKER)
    large, small = (model.texture(name) for name in ("large", "small"))
    before = large.data.reshape(1024, 2048, 3).astype(float)
    kept = model.tex_data[model.tex_adr[small.id] :].copy()
    shrink(model)
    assert model.tex_width.tolist() == [MOST, 64]
    assert model.tex_height.tolist() == [MOST // 2, 64]
    start = model.tex_adr[large.id]
    after = model.tex_data[start : start + MOST * MOST // 2 * 3].reshape(MOST // 2, MOST, 3)
    expected = before.reshape(MOST // 2, 4, MOST, 4, 3).mean(axis=(1, 3))
    assert np.abs(after - expected).max() <= 1.0
    assert np.array_equal(model.tex_data[model.tex_adr[small.id] :], kept)


def test_what_is_given_back_is_these_pixels_and_nothing_beside_them():
    pixels = np.full(1 << 20, 7, np.uint8)
    inner = pixels[5000:-5000]
    discard(inner)
    assert (pixels[:5000] == 7).all()
    assert (pixels[-5000:] == 7).all()
    assert (inner == 0).mean() > 0.95


def test_a_place_names_what_draws_the_pictures_of_a_policy_that_sees():
    seeing = PolicySpec("seeing", cameras=(CameraRequest("front", 8, 8),))
    assert "MuJoCo" in WORLD.renderer()
    assert "robosuite" in WORLD.renderer()
    assert WORLD.renderer() in in_words(here("mini", seeing, WORLD.renderer))
    assert json.loads(here("mini", PolicySpec("blind"), WORLD.renderer))["renderer"] == ""
