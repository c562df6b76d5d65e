"""A cause that is planted on an extra operator is found like any other."""

from dataclasses import replace

import pytest

from tests.failures.triage.planted import DARK, EXTRA_CONDITIONS, WITH_EXTRAS, Planted
from vlafuzz.failures.described import deviations
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.model.evidence import Causes
from vlafuzz.model.phrasing import describe
from vlafuzz.model.scene import Backdrop, InitialPose, Latency, Noise, Slide

CHECKERED = "table checker, wall red", "table planks, wall sage"
# The threshold of each planted condition, where it is one of a single number.
FAILS_FROM = {
    "initial-pose": "initial-pose: fails from j2 1.5° (",
    "sensor-noise": "sensor-noise: fails from blur 1.25 px (",
    "control-latency": "control-latency: fails from delay 2 steps (",
    "target-slide": "target-slide: fails from distance 0.045 m (",
    "camera-bump": "camera-bump: fails from pitch 2.25° (",
    "light-switch": "light-switch: fails from intensity × 0.",
    "picture-loss": "picture-loss: fails from duration 7 steps (",
    "control-stall": "control-stall: fails from duration 4 steps (",
    "grip-slip": "grip-slip: fails from duration 2 steps (",
    "grip-weak": "grip-weak: fails from force × 0.",
}


@pytest.mark.parametrize("beside", [(), ("light",)], ids=["alone", "with light"])
@pytest.mark.parametrize("name", EXTRA_CONDITIONS)
def test_shrinking_leaves_the_planted_extra_and_attribution_finds_its_threshold(name, beside):
    judge = Planted([EXTRA_CONDITIONS[name], *[DARK for _ in beside]], space=WITH_EXTRAS)
    finding = judge.finding(5)
    oracle = judge.oracle()
    shrunk = judge.shrunk(finding, oracle)
    causes = attribute(shrunk, oracle, WITH_EXTRAS)
    assert set(shrunk.operators) == set(causes.necessary) == {name, *beside}
    assert causes.sufficient == (() if beside else (name,))
    thresholds = {threshold.operator: describe(threshold) for threshold in causes.thresholds}
    assert (name in thresholds) == (name in FAILS_FROM)
    assert thresholds.get(name, "").startswith(FAILS_FROM.get(name, ""))


@pytest.mark.parametrize(
    ("part", "operator", "value", "nominal"),
    [
        ({"noise": Noise(blur=1.75, jpeg=40)}, "sensor-noise", "blur 1.75 px, jpeg 40", "blur 0 px, jpeg 100"),
        ({"initial_pose": InitialPose(j2=1.5, j7=-3)}, "initial-pose", "j2 1.5°, j7 -3°", "j2 0°, j7 0°"),
        ({"backdrop": Backdrop("checker", wall="red")}, "backdrop", *CHECKERED),
        ({"latency": Latency(3)}, "control-latency", "delay 3 steps", "delay 0 steps"),
        ({"target_slide": Slide("start", 0.05)}, "target-slide", "distance 0.05 m a second after the start", "never"),
    ],
)
def test_an_extra_is_described_in_words(part, operator, value, nominal):
    scene = replace(WITH_EXTRAS.nominal(), **part)
    (deviation,) = deviations(WITH_EXTRAS, scene, Causes())
    assert (deviation.operator, deviation.value, deviation.reference) == (operator, value, nominal)
