"""Pictures for people: with shadows, and not in the way of what policies see."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.model.scene import Light
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv

pytestmark = pytest.mark.render
SCENE = nominal("put-in")
CAMERAS = (CameraRequest("policy", 64, 64), CameraRequest("film", 96, 96))


def pictures(light: float, shown: str | None) -> list[np.ndarray]:
    env = TabletopEnv("put-in", CATALOGUE, CAMERAS, shown=shown)
    env.begin(replace(SCENE, light=Light(light)))
    seen = [env.picture("film").copy(), env.picture("policy").copy()]
    env.close()
    return seen


def test_a_film_changes_nothing_that_the_policy_sees():
    (film, seen), (_, alone) = pictures(1.0, "film"), pictures(1.0, None)
    assert np.array_equal(seen, alone)
    assert film.shape == (96, 96, 3)


def test_bright_light_is_no_white_sheet_in_a_film():
    shares = [(pictures(6.0, shown)[0].min(axis=2) > 250).mean() for shown in ("film", None)]
    assert shares[0] < 0.02
    assert shares[1] > 0.3
