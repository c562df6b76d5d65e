import pytest

from vlafuzz.model.evidence import Threshold
from vlafuzz.model.phrasing import describe, signature


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
    assert describe(both) == "camera-orientation: fails from roll 1.1°, yaw -2° (25% of the way) on"
    second = Threshold("target-position", (("targets.1.x", 0.02),), 1.0)
    assert describe(second) == "target-position: fails from x of object 2 0.02 m on"


def test_a_threshold_is_described_with_its_interval():
    bright = Threshold(
        "light", light(6.27667), 0.9, low=light(5.85634), high=light(6.4980), ranges=((light(6.27667), ()),)
    )
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
