import json

import pytest

from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.worlds import known_worlds
from vlafuzz.worlds.place import here, in_words

SEEING = PolicySpec("seeing", cameras=(CameraRequest("front", 8, 8),))


@pytest.mark.libero
def test_a_place_of_libero_names_what_draws_its_pictures_and_not_the_tabletops_renderer():
    renderer = known_worlds()["libero"].renderer
    assert "MuJoCo" in renderer()
    assert "robosuite" in renderer()
    assert renderer() in in_words(here("mini", SEEING, renderer))
    assert json.loads(here("mini", PolicySpec("blind"), renderer))["renderer"] == ""
