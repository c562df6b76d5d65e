import json
from types import SimpleNamespace

import pytest

from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.rollouts import setup
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


def test_a_world_says_itself_what_draws_its_pictures(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(known_worlds()["libero"], "renderer", lambda: "EGL of a test", raising=False)
    monkeypatch.setattr(type(known_worlds()["libero"]), "simulator", "of a test")
    policy = SimpleNamespace(spec=SEEING)
    libero, tabletop = (
        SimpleNamespace(task=SimpleNamespace(name=name), conditions={})
        for name in ("libero_goal/8", "pick-up")
    )
    assert setup.here("mini", policy, libero)["place"].count("EGL of a test") == 1
    assert "EGL of a test" not in setup.here("mini", policy, tabletop)["place"]
