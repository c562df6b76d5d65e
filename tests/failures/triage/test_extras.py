"""A cause that is planted on an extra operator is found like any other."""

from dataclasses import replace

import pytest

from tests.failures.triage.planted import DARK, EXTRA_CONDITIONS, WITH_EXTRAS, Planted
from vlafuzz.failures.described import deviations
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.model import Backdrop, Causes, InitialPose, Latency, Noise
from vlafuzz.model.scene import Slide

CHECKERED = "table checker, wall red", "table planks, wall sage"
# The value from which on each planted condition fails, where it is one of a single number.
FAILS_FROM = {
    "initial-pose": ("initial_pose.j2", 1.5),
    "sensor-noise": ("noise.blur", 1.25),
    "control-latency": ("latency.delay", 2),
    "exposure": ("exposure.auto", 0.6),
    "target-slide": ("target_slide.distance", 0.045),
    "camera-bump": ("camera_bump.pitch", 2.25),
    "light-switch": ("light_switch.intensity", 0.4),
    "picture-loss": ("picture_loss.duration", 7),
    "control-stall": ("control_stall.duration", 4),
    "grip-slip": ("grip_slip.duration", 2),
    "grip-weak": ("grip_weak.force", 0.5),
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
    found = {threshold.operator: dict(threshold.at) for threshold in causes.thresholds}
    assert (name in found) == (name in FAILS_FROM)
    if name in found:
        path, first = FAILS_FROM[name]
        grid = WITH_EXTRAS.by_path[path].grid
        assert abs(grid.snap(found[name][path]) - grid.snap(first)) <= 1


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
