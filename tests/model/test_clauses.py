"""What a cause takes, as "fails when" goes on."""

from dataclasses import replace

import pytest

from tests.failures.triage.planted import SPACE
from vlafuzz.model.scene import Camera, Light, Placement, Scene
from vlafuzz.worlds.tabletop.space import SearchSpace

NOMINAL = SPACE.nominal()
BRIGHT, DARK = replace(NOMINAL, light=Light(6.5)), replace(NOMINAL, light=Light(0.1))
TILTED = replace(NOMINAL, camera=Camera(pitch=-3.0))
WITH_APPLE = replace(NOMINAL, confounders=(Placement("apple", "upright", 0.1, 0.2),))


def beyond(path: str, value: float):
    return ((path, value),), ()


def clause(group: str, scene: Scene, *fails) -> str:
    return SPACE.clause(scene, group, NOMINAL, fails)


@pytest.mark.parametrize(
    ("group", "scene", "fails", "says"),
    [
        ("light", BRIGHT, (), "the light is 6.5 times the usual"),
        ("light", BRIGHT, (beyond("light.intensity", 5.66),), "the light is at least 5.66 times the usual"),
        ("light", DARK, (beyond("light.intensity", 0.2),), "the light is at most 0.2 times the usual"),
        ("camera-orientation", TILTED, (), "the camera tilts up by 3°"),
        ("camera-orientation", TILTED, (beyond("camera.pitch", -2.1),), "the camera tilts up by at least 2.1°"),
        ("camera-position", replace(NOMINAL, camera=Camera(0.02, 90.0)), (), "the camera is 2 cm to the right →"),
        ("camera-position", replace(NOMINAL, camera=Camera(0.02, -90.0)), (), "the camera is 2 cm to the left ←"),
        (
            "camera-position",
            replace(NOMINAL, camera=Camera(0.02, 0.0, 90.0)),
            (beyond("camera.distance", 0.012),),
            "the camera is at least 1.2 cm up ↑",
        ),
        ("confounders", WITH_APPLE, (), "apple is on the table"),
    ],
)
def test_a_cause_is_said_as_an_engineer_would(group: str, scene: Scene, fails, says: str):
    assert clause(group, scene, *fails) == says


def test_ranges_that_fail_are_said_one_after_the_other():
    turned = replace(NOMINAL, camera=Camera(yaw=5.0))
    first, second = ((("camera.yaw", 2.1),), (("camera.yaw", 3.4),)), ((("camera.yaw", 4.0),), ())
    assert clause("camera-orientation", turned, first, second) == "the camera turns left by 2.1° to 3.4° or at least 4°"


def test_of_several_targets_each_is_named():
    space = SearchSpace(SPACE.operators, SPACE.catalogue, "put-on")
    start = space.nominal()
    first, second = start.targets
    moved = replace(start, targets=(replace(first, x=0.1, yaw=45.0), replace(second, x=0.05)))
    names = [placed.object.replace("_", " ") for placed in start.targets]
    assert space.clause(moved, "target-position", start) == (
        f"{names[0]} is at x 0.1 m, y {first.y:g} m and {names[1]} is at x 0.05 m, y {second.y:g} m"
    )
    assert space.clause(moved, "target-orientation", start) == f"{names[0]} is turned to 45°"
