"""Tables and walls in other patterns and colours."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import get_args

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.errors import SimulatorError
from vlafuzz.model.scene import Backdrop, Pattern, Scene, TablePaint, WallPaint
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv, make_env
from vlafuzz.worlds.tabletop.sim.outlines import outlines
from vlafuzz.worlds.tabletop.sim.table import PAINTS, shade

STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
TABLE, WALL = (slice(90, 120), slice(40, 90)), (slice(0, 4), slice(None))  # pixels that show nothing else


def before(**backdrop: str) -> Scene:
    return replace(nominal(), backdrop=Backdrop(**backdrop))


@pytest.fixture(scope="module")
def env() -> Iterator[TabletopEnv]:
    made = make_env("pick-up", CATALOGUE, (CameraRequest("third_person", 128, 128),))
    yield made
    made.close()


def picture(env: TabletopEnv, scene: Scene) -> np.ndarray:
    env.begin(scene)
    env.applied().check(scene, env.poses, env.rig)
    return env.picture("third_person").astype(float)


def test_every_paint_and_pattern_of_a_scene_is_known():
    assert {*get_args(TablePaint), *get_args(WallPaint)} == set(PAINTS)
    shades = [shade(pattern) for pattern in get_args(Pattern)]
    assert all(one.shape == (256, 256) and one.min() > 0 for one in shades)
    assert not any(np.allclose(one, other) for one, other in combinations(shades, 2))


@pytest.mark.render
def test_pattern_and_colour_show_on_the_table(env):
    usual, blue = picture(env, nominal()), picture(env, before(colour="blue"))
    assert usual[TABLE][..., 0].mean() > usual[TABLE][..., 2].mean() + 10
    assert blue[TABLE][..., 2].mean() > blue[TABLE][..., 0].mean() + 30
    plain, checker = (picture(env, before(table=pattern))[TABLE] for pattern in ("plain", "checker"))
    assert checker.std(axis=(0, 1)).mean() > plain.std(axis=(0, 1)).mean() + 10


@pytest.mark.render
def test_the_walls_colour_shows_behind_the_robot_and_not_on_the_table(env):
    usual, red = picture(env, nominal()), picture(env, before(wall="red"))
    assert np.array_equal(usual[TABLE], red[TABLE])
    assert red[WALL][..., 1].mean() < usual[WALL][..., 1].mean() - 5


@pytest.mark.render
def test_a_nominal_picture_is_the_same_before_and_after_another_backdrop(env):
    usual = picture(env, nominal())
    picture(env, before(table="stripes", colour="green", wall="black"))
    assert np.array_equal(picture(env, nominal()), usual)


@pytest.mark.render
def test_a_backdrop_that_is_not_shown_is_noticed(env):
    env.begin(nominal())
    with pytest.raises(SimulatorError, match="backdrop: asked for"):
        env.applied().check(before(wall="red"), env.poses, env.rig)


def test_without_a_renderer_outlines_have_the_tables_colour_and_physics_is_the_same():
    env, hashes, tables = make_env("pick-up", CATALOGUE), [], []
    for scene in (nominal(), before(table="checker", colour="blue", wall="red")):
        state = env.begin(scene)
        env.applied().check(scene, env.poses, env.rig)
        tables.append(outlines(env.models, state, env.view, env.light, env.table_colour).table)
        env.advance(STILL)
        hashes.append(env.world.states_hash)
    env.close()
    assert tables[1] == pytest.approx(PAINTS["blue"])
    assert tables[0] == pytest.approx(PAINTS["oak"])
    assert hashes[0] == hashes[1]
