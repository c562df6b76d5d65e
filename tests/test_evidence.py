from vlafuzz.evidence import Threshold
from vlafuzz.phrasing import describe, signature


def test_a_signature_names_task_stage_and_operators():
    assert signature("pick-up", "grasp", ["light", "camera-orientation"]) == (
        "pick-up|grasp|camera-orientation+light"
    )
    assert signature("put-on", "move", []) == "put-on|move|base"


def test_a_threshold_is_described_with_units():
    both = Threshold("camera-orientation", (("camera.roll", 1.1), ("camera.yaw", -2.0)), 0.25)
    assert describe(both) == "camera-orientation: fails from roll 1.1°, yaw -2° (25% of the way) on"
    second = Threshold("target-position", (("targets.1.x", 0.02),), 1.0)
    assert describe(second) == "target-position: fails from x of object 2 0.02 m on"
