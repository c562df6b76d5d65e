"""What is left of a failing scene is what was planted, operator by operator."""

from itertools import combinations
from statistics import median

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.triage.planted import CONDITIONS, SPACE, Planted, fair
from vlafuzz.outcome import Verdict
from vlafuzz.triage.attribute import attribute
from vlafuzz.triage.oracle import Judged
from vlafuzz.triage.path import GROUPS
from vlafuzz.triage.shrink import shrink

SINGLES = [((name,), (condition,)) for name, several in CONDITIONS.items() for condition in several]
PAIRS = [
    ((a, b), (CONDITIONS[a][number % len(CONDITIONS[a])], CONDITIONS[b][number % len(CONDITIONS[b])]))
    for number, (a, b) in enumerate(combinations(CONDITIONS, 2))
]
CASES = [*SINGLES, *PAIRS]
planted = st.sampled_from(CASES)
seeds = st.integers(0, 2**32)


def test_shrinking_and_attributing_find_exactly_the_planted_operators_of_35_in_40_rollouts():
    assert len(CASES) >= 25
    spent, wrong = [], []
    for seed, (operators, conditions) in enumerate(CASES):
        judge = Planted(conditions)
        found = judge.finding(seed)
        oracle = judge.oracle(found)
        shrunk = shrink(found, oracle, SPACE)
        causes = attribute(shrunk, oracle, SPACE)
        spent.append(oracle.spent)
        enough = operators if len(operators) == 1 else ()
        if (set(shrunk.operators), causes.necessary, causes.sufficient) != (
            set(operators),
            shrunk.operators,
            enough,
        ):
            wrong.append((operators, shrunk.operators, shrunk.unresolved))
    assert len(wrong) <= 0.05 * len(CASES), wrong
    assert median(spent) <= 40


@settings(max_examples=60, deadline=None)
@given(planted, seeds)
def test_what_is_left_fails_is_fair_is_milder_and_takes_every_operator(case, seed):
    judge = Planted(case[1])
    found = judge.finding(seed)
    oracle = judge.oracle(found)
    shrunk = shrink(found, oracle, SPACE)
    assert judge.fails(shrunk.scene)
    assert fair(shrunk.scene)
    assert SPACE.severity(shrunk.scene) <= SPACE.severity(found) + 1e-9
    assert shrunk.scene.targets[0].object == found.targets[0].object
    assert {*shrunk.counterparts, *shrunk.unresolved} == {*shrunk.operators}
    for name, counterpart in shrunk.counterparts.items():
        assert counterpart == SPACE.reset(shrunk.scene, GROUPS[name])
        assert judge.judged(counterpart).verdict is Verdict.PASSED


@settings(max_examples=40, deadline=None)
@given(planted, seeds, st.integers(0, 60))
def test_the_bound_on_rollouts_holds_and_the_best_so_far_is_kept(case, seed, most):
    judge = Planted(case[1])
    found = judge.finding(seed)
    oracle = judge.oracle(found, most)
    shrunk = shrink(found, oracle, SPACE)
    attribute(shrunk, oracle, SPACE)
    assert judge.rollouts == oracle.spent <= most
    assert judge.fails(shrunk.scene)
    assert SPACE.severity(shrunk.scene) <= SPACE.severity(found) + 1e-9


@pytest.mark.parametrize("most", [12, 16, 20, 25])
def test_what_a_bound_cuts_short_is_shown_to_take_its_operators_all_the_same(most):
    judge = Planted(PAIRS[-1][1])
    found = judge.finding(3)
    oracle = judge.oracle(found, most)
    shrunk = shrink(found, oracle, SPACE)
    assert {*shrunk.counterparts} == {*shrunk.operators} - {*shrunk.unresolved}
    assert shrunk.minimal or most < 16
    assert oracle.spent <= most


def test_no_scene_is_asked_for_twice():
    judge = Planted(PAIRS[3][1])
    found = judge.finding(1)
    oracle = judge.oracle(found)
    attribute(shrink(found, oracle, SPACE), oracle, SPACE)
    assert len(judge.asked) == len(set(judge.asked))


def test_a_value_stops_two_steps_past_its_threshold():
    judge = Planted([lambda scene: scene.camera.yaw > 2.5])
    found = judge.finding(4)
    assert found.camera.yaw > 2.8
    shrunk = shrink(found, judge.oracle(found), SPACE)
    assert (shrunk.scene.camera.yaw, shrunk.operators) == (2.8, ("camera-orientation",))


def test_where_even_the_nominal_scene_fails_nothing_is_attributed():
    judge = Planted([lambda scene: True])
    found = judge.finding(0)
    oracle = judge.oracle(found)
    shrunk = shrink(found, oracle, SPACE)
    assert (shrunk.base, shrunk.operators, shrunk.minimal, oracle.spent) == (True, (), False, 1)


def test_of_two_causes_either_of_which_is_enough_one_is_left():
    dark, tilted = CONDITIONS["light"][0], CONDITIONS["camera-orientation"][0]
    both = Planted([dark, tilted]).finding(0)
    judge = Planted([lambda scene: dark(scene) or tilted(scene)])
    shrunk = shrink(both, judge.oracle(both), SPACE)
    assert shrunk.minimal
    assert len(shrunk.operators) == 1


class Later(Planted):
    """Without the dark it gets on to the lift, and fails there."""

    def judged(self, scene):
        judged = super().judged(scene)
        tilted = CONDITIONS["camera-orientation"][0](scene)
        passed_in_tilt = judged.verdict is Verdict.PASSED and tilted
        return Judged(Verdict.FAILED, "lift", 1) if passed_in_tilt else judged


def test_a_loss_at_a_later_stage_is_neither_the_same_failure_nor_a_pass():
    judge = Later([CONDITIONS["light"][0], CONDITIONS["camera-orientation"][0]])
    found = judge.finding(0)
    shrunk = shrink(found, judge.oracle(found), SPACE)
    assert shrunk.operators == ("light", "camera-orientation")
    assert shrunk.unresolved == {"light": "fails at lift"}
    assert not shrunk.minimal


@pytest.mark.parametrize("verdict", [Verdict.INVALID, Verdict.ERROR])
def test_what_is_not_fair_or_crashes_counts_as_not_failing(verdict):
    judge = Planted([CONDITIONS["light"][0]])
    judge.judged = lambda scene: Judged(verdict, None, int(verdict is Verdict.ERROR))
    found = Planted([CONDITIONS["light"][0]]).finding(0)
    oracle = judge.oracle(found)
    shrunk = shrink(found, oracle, SPACE)
    assert (shrunk.scene, shrunk.counterparts) == (found, {})
    assert oracle.spent == (len(judge.asked) if verdict is Verdict.ERROR else 0)


@pytest.mark.parametrize(("confounded", "tilted", "seed"), [(0, 0, 7), (0, 1, 1), (1, 0, 7), (1, 1, 5)])
def test_a_target_and_a_confounder_that_block_each_other_are_moved_together(confounded, tilted, seed):
    operators = ("confounders", "camera-orientation")
    judge = Planted([CONDITIONS[operators[0]][confounded], CONDITIONS[operators[1]][tilted]])
    found = judge.finding(seed)
    shrunk = shrink(found, judge.oracle(found), SPACE)
    assert (shrunk.operators, shrunk.minimal) == (operators, True)
