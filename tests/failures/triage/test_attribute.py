import pytest

from tests.failures.triage.planted import CONDITIONS, EDGES, SPACE, STAGES, Condition, Planted
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.path import directed
from vlafuzz.model.evidence import Causes, Rate
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.store.records import Judged


def causes(*conditions: Condition, seed: int = 0) -> tuple[Causes, Planted]:
    judge = Planted(conditions)
    oracle = judge.oracle()
    return attribute(judge.shrunk(judge.finding(seed), oracle), oracle, SPACE), judge


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: edge[1])
def test_a_threshold_is_the_first_value_that_fails(edge):
    operator, path, first, step, condition = edge
    judge = Planted([condition])
    oracle = judge.oracle()
    shrunk = judge.shrunk(judge.finding(0), oracle)
    (threshold,) = attribute(shrunk, oracle, SPACE).thresholds
    assert threshold.operator == operator
    ((where, value),) = threshold.at
    assert (where, value) == (path, pytest.approx(first, abs=1.01 * step))
    ends = [dict(end)[path] for end in (threshold.low, threshold.high)]
    assert min(ends) <= first <= max(ends)
    assert threshold.ranges == ((threshold.at, ()),)
    assert threshold.direction == directed(SPACE, shrunk.scene, [operator])[0].partition(":")[2]


def test_a_threshold_says_where_the_policy_passes_beyond_it():
    found, _ = causes(lambda s: 2.1 < s.camera.yaw < 3.45 or s.camera.yaw > 4.05, seed=3)
    (threshold,) = found.thresholds
    assert describe(threshold).startswith("camera-orientation: fails from yaw 2.2° (")
    assert describe(threshold).endswith(") to 3.4° and from 4.1° on")


def test_there_is_no_threshold_beside_what_is_not_fair():
    dark = CONDITIONS["light"][0]
    planted = Planted([dark])
    scene = planted.finding(0)

    def judge(scenes, numbers):
        return [planted.judged(shown) if planted.fails(shown) else Judged(Verdict.INVALID) for shown in scenes]

    oracle = Oracle(judge, STAGES, None, budget=200, lead=1)
    shrunk = Shrunk(scene=scene, lost="grasp", operators=("light",), rate=Rate.of_counts(5, 5), firm=True)
    assert attribute(shrunk, oracle, SPACE).thresholds == ()


def test_several_values_of_an_operator_have_a_share_of_the_way():
    found, _ = causes(lambda s: s.camera.yaw + s.camera.roll > 3 and s.camera.yaw > 1 and s.camera.roll > 1)
    (threshold,) = found.thresholds
    assert [path for path, _ in threshold.at] == ["camera.roll", "camera.yaw"]
    at = dict(threshold.at)
    assert at["camera.roll"] + at["camera.yaw"] == pytest.approx(3.1, abs=0.21)
    assert 0 < threshold.share < 1


def test_of_two_that_are_necessary_neither_is_enough_and_both_have_thresholds():
    found, _ = causes(lambda s: s.camera.yaw > 2.5, lambda s: s.light.intensity < 0.4)
    assert found.necessary == ("light", "camera-orientation")
    assert found.sufficient == ()
    ((_, intensity),), ((_, yaw),) = (threshold.at for threshold in found.thresholds)
    assert (intensity, yaw) == (pytest.approx(0.4, abs=0.03), pytest.approx(2.6, abs=0.11))
