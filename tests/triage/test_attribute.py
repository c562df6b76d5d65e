from itertools import combinations

import pytest

from tests.triage.planted import CONDITIONS, EDGES, SPACE, STAGES, Condition, Planted
from vlafuzz.evidence import Causes, Rate
from vlafuzz.outcome import Verdict
from vlafuzz.phrasing import describe
from vlafuzz.triage.attribute import attribute
from vlafuzz.triage.certify import Shrunk
from vlafuzz.triage.oracle import Judged, Oracle


def causes(*conditions: Condition, seed: int = 0) -> tuple[Causes, Planted]:
    judge = Planted(conditions)
    oracle = judge.oracle()
    return attribute(judge.shrunk(judge.finding(seed), oracle), oracle, SPACE), judge


@pytest.mark.parametrize(
    ("condition", "operator", "value", "says"),
    [
        (lambda s: s.camera.yaw > 2.5, "camera-orientation", 2.6, "fails from yaw 2.6° on"),
        (lambda s: s.camera.roll < -1, "camera-orientation", -1.1, "fails from roll -1.1° on"),
        (lambda s: s.camera.distance > 0.02, "camera-position", 0.021, "fails from distance 0.021 m on"),
        (lambda s: s.targets[0].x > 0.02, "target-position", 0.021, "fails from x 0.021 m on"),
        (lambda s: s.light.intensity < 0.4, "light", 0.39, "fails from intensity × 0.39 on"),
        (lambda s: s.targets[0].yaw < -30, "target-orientation", -31, "fails from yaw -31° on"),
    ],
)
def test_a_threshold_is_the_first_value_that_fails(condition, operator, value, says):
    found, _ = causes(condition)
    (threshold,) = found.thresholds
    assert threshold.operator == operator
    ((_, first),) = threshold.at
    assert first == pytest.approx(value, rel=0.03)
    if operator != "light":
        assert describe(threshold) == f"{operator}: {says}"


def test_there_is_no_threshold_beside_what_is_not_fair():
    dark = CONDITIONS["light"][0]
    planted = Planted([dark])
    scene = planted.finding(0)

    def judge(scenes, numbers):
        return [
            planted.judged(shown) if planted.fails(shown) else Judged(Verdict.INVALID) for shown in scenes
        ]

    oracle = Oracle(judge, STAGES, None, budget=200, lead=1)
    shrunk = Shrunk(scene=scene, lost="grasp", operators=("light",), rate=Rate.of_counts(5, 5))
    assert attribute(shrunk, oracle, SPACE).thresholds == ()


def test_several_values_of_an_operator_have_a_share_of_the_way():
    found, _ = causes(lambda s: s.camera.yaw + s.camera.roll > 3 and s.camera.yaw > 1 and s.camera.roll > 1)
    (threshold,) = found.thresholds
    assert [path for path, _ in threshold.at] == ["camera.roll", "camera.yaw"]
    assert 0.7 < threshold.share <= 1


def test_of_two_that_are_necessary_neither_is_enough():
    found, _ = causes(lambda s: s.camera.yaw > 2.5, lambda s: s.light.intensity < 0.4)
    assert found.necessary == ("light", "camera-orientation")
    assert found.sufficient == ()
    assert [threshold.operator for threshold in found.thresholds] == ["light", "camera-orientation"]


def test_thresholds_of_single_operators_and_pairs_are_within_a_grid_step():
    pairs = [(a, b) for a, b in combinations(EDGES, 2) if a[0] != b[0]]
    right = []
    for seed, edges in enumerate([*((edge,) for edge in EDGES), *pairs]):
        found, _ = causes(*(edge[-1] for edge in edges), seed=seed)
        values = {path: value for each in found.thresholds for path, value in each.at}
        for _, path, first, step, _ in edges:
            right.append(path in values and abs(values[path] - first) < 1.01 * step)
    assert len(right) >= 25
    assert sum(right) >= 0.9 * len(right)
