from itertools import combinations

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
