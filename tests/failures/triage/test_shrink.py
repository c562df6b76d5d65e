"""What is left of a failing scene is what was planted, operator by operator."""

from itertools import combinations
from statistics import median

import pytest
from hypothesis import given, settings, strategies as st

from tests.failures.triage.planted import CONDITIONS, DARK, SPACE, STAGES, TILTED, Planted, fair
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Certifier
from vlafuzz.failures.triage.shrink import Reference, Shrinker
from vlafuzz.model import Verdict
from vlafuzz.store.records import Judged
from vlafuzz.worlds.manipulation.space import GROUPS

SINGLES = [((name,), (condition,)) for name, several in CONDITIONS.items() for condition in several]
PAIRS = [
    ((a, b), (CONDITIONS[a][number % len(CONDITIONS[a])], CONDITIONS[b][number % len(CONDITIONS[b])]))
    for number, (a, b) in enumerate(combinations(CONDITIONS, 2))
]
CASES = [*SINGLES, *PAIRS]
planted = st.sampled_from(CASES)
seeds = st.integers(0, 2**32)


def test_shrinking_and_attributing_find_exactly_the_planted_operators_of_35_in_55_rollouts():
    assert len(CASES) >= 25
    spent, wrong = [], []
    for seed, (operators, conditions) in enumerate(CASES):
        judge = Planted(conditions)
        oracle = judge.oracle()
        shrunk = judge.shrunk(judge.finding(seed), oracle)
        causes = attribute(shrunk, oracle, SPACE)
        spent.append(oracle.spent)
        enough = operators if len(operators) == 1 else ()
        if (set(shrunk.operators), causes.necessary, causes.sufficient) != (set(operators), shrunk.operators, enough):
            wrong.append((operators, shrunk.operators, shrunk.unresolved))
    assert len(wrong) <= 0.05 * len(CASES), wrong
    assert median(spent) <= 55


@given(planted, seeds)
def test_what_is_left_fails_is_fair_is_milder_and_takes_every_operator(case, seed):
    judge = Planted(case[1])
    finding = judge.finding(seed)
    shrunk = judge.shrunk(finding)
    assert judge.fails(shrunk.scene)
    assert fair(shrunk.scene)
    assert SPACE.severity(shrunk.scene) <= SPACE.severity(finding) + 1e-9
    assert shrunk.scene.targets[0].object == finding.targets[0].object
    assert {*shrunk.counterparts, *shrunk.unresolved} == {*shrunk.operators}
    for name, counterpart in shrunk.counterparts.items():
        assert counterpart == SPACE.reset(shrunk.scene, GROUPS[name])
        assert judge.judged(counterpart).verdict is Verdict.PASSED
        assert shrunk.rates[name].failures == 0


@settings(max_examples=20)
@given(planted, seeds)
def test_with_a_reference_elsewhere_what_is_left_differs_from_it_in_what_it_takes_alone(case, seed):
    judge = Planted(case[1])
    finding = judge.finding(seed)
    reference = SPACE.reset(finding, [operator for name in case[0] for operator in GROUPS[name]])
    if judge.judged(reference).verdict is not Verdict.PASSED:
        return
    oracle = judge.oracle()
    way = Shrinker(SPACE, oracle, [finding], reference).shrink()
    shrunk = Certifier(oracle, SPACE, Reference(reference, STAGES)).certify(way)
    assert judge.fails(shrunk.scene)
    assert set(shrunk.operators) <= set(case[0])
    for name, counterpart in shrunk.counterparts.items():
        assert counterpart == SPACE.reset(shrunk.scene, GROUPS[name], reference)


@settings(max_examples=20)
@given(planted, seeds, st.integers(0, 60))
def test_the_bound_on_rollouts_holds_and_the_best_so_far_is_kept(case, seed, most):
    judge = Planted(case[1])
    finding = judge.finding(seed)
    oracle = judge.oracle(most)
    shrunk = judge.shrunk(finding, oracle)
    attribute(shrunk, oracle, SPACE)
    assert judge.rollouts == oracle.spent <= most
    assert judge.fails(shrunk.scene)
    assert SPACE.severity(shrunk.scene) <= SPACE.severity(finding) + 1e-9


def test_of_two_causes_either_of_which_is_enough_one_is_left():
    both = Planted([DARK, TILTED]).finding(0)
    judge = Planted([lambda scene: DARK(scene) or TILTED(scene)])
    shrunk = judge.shrunk(both)
    assert shrunk.minimal
    assert len(shrunk.operators) == 1


class Later(Planted):
    """Without the dark it gets on to the lift, and fails there."""

    def judged(self, scene):
        judged = super().judged(scene)
        passed_in_tilt = judged.verdict is Verdict.PASSED and TILTED(scene)
        return Judged(Verdict.FAILED, "lift", 1) if passed_in_tilt else judged


def test_a_loss_at_a_later_stage_is_neither_the_same_failure_nor_a_pass():
    judge = Later([DARK, TILTED])
    shrunk = judge.shrunk(judge.finding(0))
    assert shrunk.operators == ("light", "camera-orientation")
    assert shrunk.unresolved == {"light": "fails at lift"}
    assert not shrunk.minimal


@pytest.mark.parametrize("verdict", [Verdict.INVALID, Verdict.ERROR])
def test_what_is_not_fair_or_crashes_counts_as_not_failing(verdict):
    judge = Planted([DARK])
    judge.judged = lambda scene: Judged(verdict, None, int(verdict is Verdict.ERROR))
    finding = Planted([DARK]).finding(0)
    oracle = judge.oracle()
    assert Shrinker(SPACE, oracle, [finding]).shrink() == [finding]
    assert oracle.spent == (len(judge.asked) if verdict is Verdict.ERROR else 0)


@pytest.mark.parametrize(("confounded", "tilted", "seed"), [(0, 0, 7), (0, 1, 1), (1, 0, 7), (1, 1, 5)])
def test_a_target_and_a_confounder_that_block_each_other_are_moved_together(confounded, tilted, seed):
    operators = ("confounders", "camera-orientation")
    judge = Planted([CONDITIONS[operators[0]][confounded], CONDITIONS[operators[1]][tilted]])
    shrunk = judge.shrunk(judge.finding(seed))
    assert (shrunk.operators, shrunk.minimal) == (operators, True)
