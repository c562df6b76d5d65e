"""A cause that is planted on an extra operator is found like any other."""

import pytest

from tests.triage.planted import CONDITIONS, EXTRA_CONDITIONS, WITH_EXTRAS, Planted
from vlafuzz.report.deviations import deviations
from vlafuzz.triage.attribute import attribute
from vlafuzz.triage.shrink import shrink

LIGHT = CONDITIONS["light"][0]
# The threshold of each planted condition, where it is one of a single number.
FAILS_FROM = {
    "control-latency": "control-latency: fails from delay 2 steps on",
}


@pytest.mark.parametrize("beside", [(), ("light",)], ids=["alone", "with light"])
@pytest.mark.parametrize("name", EXTRA_CONDITIONS)
def test_shrinking_leaves_the_planted_extra_and_attribution_finds_its_threshold(name, beside):
    judge = Planted([EXTRA_CONDITIONS[name], *[LIGHT for _ in beside]], space=WITH_EXTRAS)
    finding = judge.finding(1)
    oracle = judge.oracle(finding)
    shrunk = shrink(finding, oracle, WITH_EXTRAS)
    causes = attribute(shrunk, oracle, WITH_EXTRAS)
    assert set(shrunk.operators) == set(causes.necessary) == {name, *beside}
    assert causes.sufficient == (() if beside else (name,))
    thresholds = {threshold.operator: str(threshold) for threshold in causes.thresholds}
    assert thresholds.get(name) == FAILS_FROM.get(name)


@pytest.mark.parametrize("name", EXTRA_CONDITIONS)
def test_a_shrunk_extra_is_described_in_words(name):
    judge = Planted([EXTRA_CONDITIONS[name]], space=WITH_EXTRAS)
    finding = judge.finding(2)
    oracle = judge.oracle(finding)
    shrunk = shrink(finding, oracle, WITH_EXTRAS)
    (deviation,) = deviations(WITH_EXTRAS, shrunk.scene, attribute(shrunk, oracle, WITH_EXTRAS))
    assert (deviation.operator, deviation.value, deviation.nominal) == (name, *WORDS[name])


WORDS = {
    "control-latency": ("delay 3 steps", "delay 0 steps"),
}
