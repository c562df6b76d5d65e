"""Causes, thresholds and signatures in words."""

from dataclasses import replace

import pytest

from tests.failures.triage.planted import SPACE, WITH_EXTRAS
from vlafuzz.model import Backdrop, Camera, Light, Placement, Scene, Threshold
from vlafuzz.model.phrasing import describe, signature
from vlafuzz.model.scene import CameraBump, PictureLoss
from vlafuzz.model.space import spoken
from vlafuzz.worlds.tabletop.space import SearchSpace


def test_a_signature_names_task_stage_and_operators_with_their_directions():
    assert signature("pick-up", "grasp", ["light:dark", "camera-orientation:-roll,+yaw"]) == (
        "pick-up|grasp|camera-orientation:-roll,+yaw+light:dark"
    )
    assert signature("put-on", "move", []) == "put-on|move|base"


def light(intensity: float):
    return (("light.intensity", intensity),)


def yaw(degrees: float):
    return (("camera.yaw", degrees),)


def test_a_threshold_is_described_with_units():
    both = Threshold("camera-orientation", (("camera.roll", 1.1), ("camera.yaw", -2.0)), 0.25)
    assert describe(both) == "camera-orientation: fails from roll 1.1°, yaw -2° (25% of the way to the failure) on"
    second = Threshold("target-position", (("targets.1.x", 0.02),), 1.0)
    assert describe(second) == "target-position: fails from x of object 2 0.02 m on"


def test_a_threshold_is_described_with_its_interval():
    at, low, high = map(light, (6.27667, 5.85634, 6.4980))
    bright = Threshold("light", at, 0.9, low=low, high=high, ranges=((at, ()),))
    assert describe(bright) == "light: fails from intensity × 6.28 (× 5.86 to × 6.5) on"
    turned = Threshold("camera-orientation", yaw(-2.1), 0.9, low=yaw(-2.0), high=yaw(-2.2))
    assert describe(turned) == "camera-orientation: fails from yaw -2.1° (-2.2° to -2°) on"


def test_an_interval_across_half_a_turn_goes_the_short_way():
    def at(degrees: float):
        return (("targets.0.yaw", degrees),)

    ahead = Threshold("target-orientation", at(179.0), 0.9, low=at(178.0), high=at(-176.0))
    assert describe(ahead) == "target-orientation: fails from yaw 179° (178° to -176°) on"
    back = Threshold("target-orientation", at(179.0), 0.9, low=at(-176.0), high=at(178.0))
    assert describe(back) == describe(ahead)


def test_passes_beyond_a_threshold_are_said():
    ranges = ((yaw(2.1), yaw(3.4)), (yaw(3.8), yaw(3.8)), (yaw(4.0), ()))
    threshold = Threshold("camera-orientation", yaw(2.1), 0.9, low=yaw(2.1), high=yaw(2.1), ranges=ranges)
    assert describe(threshold) == ("camera-orientation: fails from yaw 2.1° to 3.4° and at 3.8° and from 4° on")


def test_a_threshold_has_bounds_for_its_own_values_alone():
    other = (("light.intensity", 0.5),)
    broken = [{"low": yaw(1.0)}, {"low": other, "high": other}, {"ranges": ((other, ()),)}]
    for bounds in broken:
        with pytest.raises(ValueError, match="a threshold of camera-orientation"):
            Threshold("camera-orientation", yaw(2.1), 0.9, **bounds)
    with pytest.raises(ValueError, match="without its values"):
        Threshold("camera-orientation", (), 0.9)


NOMINAL = SPACE.nominal()
BRIGHT, DARK = replace(NOMINAL, light=Light(6.5)), replace(NOMINAL, light=Light(0.1))
TILTED = replace(NOMINAL, camera=Camera(pitch=-3.0))
WITH_APPLE = replace(NOMINAL, confounders=(Placement("apple", "upright", 0.1, 0.2),))

FROZEN = replace(NOMINAL, picture_loss=PictureLoss(duration=7))
BUMPED = replace(NOMINAL, camera_bump=CameraBump("start", yaw=5.0))


def beyond(path: str, value: float):
    return ((path, value),), ()


def clause(group: str, scene: Scene, *fails) -> str:
    return WITH_EXTRAS.clause(scene, group, NOMINAL, fails)


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
        ("backdrop", replace(NOMINAL, backdrop=Backdrop(colour="black")), (), "the table is black"),
        (
            "backdrop",
            replace(NOMINAL, backdrop=Backdrop("checker", wall="red")),
            (),
            "the table's pattern is checker and the wall is red",
        ),
        ("picture-loss", FROZEN, (), "the pictures stop (duration 7 steps) while the hand approaches"),
        ("camera-bump", BUMPED, (), "the camera turns left by 5° a second after the start"),
        (
            "picture-loss",
            FROZEN,
            (beyond("picture_loss.duration", 4),),
            "the pictures stop for at least 4 steps while the hand approaches",
        ),
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


def test_a_field_that_begins_with_its_operators_name_is_said_once():
    assert (spoken("goal", "goal-x"), spoken("light", "intensity"), spoken("target-type")) == (
        "goal's x", "light intensity", "target type",
    )  # fmt: skip
    assert spoken("confounder-position", "nearness of the first confounder") == "nearness of the first confounder"
