"""When a policy counts as worse, which rollouts this takes, and how the scenes are classified."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import manifest, scene
from tests.regression.corpora import case, make_corpus
from tests.regression.sides import Planned, RuleRunner, flaky, probes
from vlafuzz.outcome import Verdict
from vlafuzz.regression.pairs import probes as probes_of
from vlafuzz.regression.regress import Progress, Recorded, Rerun, compare, records_hold
from vlafuzz.statistics import wilson

RECORDED = Recorded("old as recorded")
SAME = Planned(lambda number, repeat: number >= 20)


def test_a_policy_that_does_as_recorded_is_not_worse_and_every_scene_is_run_once():
    policy = Planned(lambda number, repeat: number >= 20)
    result = compare(probes(), policy, RECORDED)
    assert (result.alarm, result.stopped, result.p_value, result.needed) == (False, "done", 1, 5)
    assert sorted(policy.calls) == [(number, 0) for number in range(60)]
    assert Counter(scene.standing for scene in result.compared) == {"fails": 20, "passes": 40}


def test_one_that_breaks_controls_is_worse_and_the_rest_is_spared():
    policy = Planned(lambda number, repeat: number >= 40)
    result = compare(probes(), policy, RECORDED)
    assert (result.alarm, result.stopped) == (True, "worse")
    assert (result.total.worse, result.needed) == (5, 0)
    assert 5 <= len(policy.calls) < 60
    assert [scene.standing for scene in result.compared].count("not run") == 60 - len(policy.calls)
    assert "new is worse than old as recorded: 5 worse and 0 better" in result.verdict


def test_four_broken_controls_are_no_alarm():
    result = compare(probes(), Planned(lambda number, repeat: number >= 24), RECORDED)
    assert (result.alarm, result.total.worse, result.stopped) == (False, 4, "done")
    assert "1 more broken controls would make an alarm" in result.verdict


def test_solved_failures_do_not_make_up_for_broken_controls():
    result = compare(probes(), Planned(lambda number, repeat: number >= 30 or number < 15), RECORDED)
    assert result.alarm
    failing, *controls = (result.tally(group) for group in ("failing", "counterpart", "nominal"))
    assert (failing.worse, sum(tally.better for tally in controls)) == (0, 0)
    assert failing.better > 0
    assert sum(tally.worse for tally in controls) == 7


def test_a_bug_that_came_back_counts_though_its_scene_is_no_control():
    old = Planned(lambda number, repeat: True, name="old")
    assert compare(probes(), Planned(lambda number, repeat: number >= 10), old).alarm


def test_a_better_policy_is_not_worse():
    result = compare(probes(), Planned(lambda number, repeat: True), RECORDED)
    assert (result.alarm, result.total.better) == (False, 20)


def test_the_order_is_shuffled_and_always_the_same():
    orders = []
    for _ in range(2):
        policy = Planned(lambda number, repeat: number >= 20)
        compare(probes(), policy, RECORDED)
        orders.append(policy.calls)
    assert orders[0] == orders[1] != sorted(orders[0])


def test_a_stochastic_policy_is_repeated_until_no_alarm_can_come():
    policy = Planned(lambda number, repeat: number >= 20, deterministic=False)
    result = compare(probes(2, 1), policy, Planned(lambda number, repeat: number >= 20), max_rollouts=9)
    assert result.stopped == "hopeless"
    assert Counter(repeat for _, repeat in policy.calls) == {0: 3, 1: 2}


@pytest.mark.parametrize(("deterministic", "bound", "most"), [(True, 100, 60), (True, 7, 7), (False, 70, 70)])
def test_no_more_than_the_rollouts_asked_for(deterministic, bound, most):
    alternating = Planned(lambda number, repeat: number % 2 == 0, deterministic=deterministic)
    seen: list[Progress] = []
    compare(probes(), alternating, RECORDED, max_rollouts=bound, alpha=1e-9, watch=seen.append)
    assert seen[-1].most == most
    assert len(alternating.calls) <= most


def test_errors_and_unfair_scenes_are_counted_apart_and_never_worse():
    def rule(number: int, repeat: int) -> Verdict | bool:
        return Verdict.ERROR if number % 10 == 1 else Verdict.INVALID if number % 10 == 2 else number >= 20

    result = compare(probes(), Planned(rule), RECORDED)
    standings = Counter(scene.standing for scene in result.compared)
    assert (standings["error"], standings["invalid"], standings["worse"]) == (6, 6, 0)
    assert (result.total.worse, result.total.baseline.of, result.tells) == (0, 48, True)
    assert {scene.detail for scene in result.compared if scene.standing == "error"} == {"policy: connect"}


@pytest.mark.parametrize("broken", ["policy", "baseline"])
def test_a_side_that_only_breaks_is_given_up_early_without_a_verdict(broken):
    wreck = Planned(lambda number, repeat: Verdict.ERROR)
    fine = Planned(lambda number, repeat: True)
    sides = (wreck, fine) if broken == "policy" else (fine, wreck)
    result = compare(probes(), *sides)
    assert (result.stopped, result.tells, result.alarm, len(wreck.calls)) == ("unjudged", False, False, 10)
    assert result.verdict == "cannot tell: only 0 of 10 rollouts could be judged"


def test_a_verdict_needs_half_of_the_pairs():
    result = compare(
        probes(), Planned(lambda number, repeat: Verdict.ERROR if number % 3 else True), RECORDED
    )
    assert (result.stopped, result.tells) == ("done", False)


def test_a_flaky_policy_against_itself_hardly_raises_an_alarm():
    rng, runs, small = np.random.default_rng(0), 2000, probes(10, 20)
    alarms = sum(compare(small, flaky(0.3, rng), flaky(0.3, rng), max_rollouts=60).alarm for _ in range(runs))
    assert wilson(alarms, runs).low <= 0.05


def test_a_flaky_policy_that_fails_much_more_often_is_found_out():
    rng = np.random.default_rng(0)
    alarms = [compare(probes(), flaky(0.6, rng), flaky(0.3, rng)).alarm for _ in range(40)]
    assert sum(alarms) >= 36


def test_every_scene_of_a_corpus_is_probed_once_in_the_most_telling_group():
    scenes = probes_of(make_corpus(case(0), case(1), case(1)))
    assert [(probe.group, probe.passed) for probe in scenes] == [
        ("failing", False),
        ("failing", False),
        ("nominal", True),
        ("counterpart", True),
    ]
    assert scenes[0].what == "light: fails from intensity × 0.25 on"
    assert scenes[3].what.endswith(" without light")
    assert next(probe for probe in scenes if probe.group == "nominal").scene == scene()


def test_a_control_that_failed_is_recorded_as_such():
    nominal = next(
        probe
        for probe in probes_of(make_corpus(replace(case(1), nominal_passes=False)))
        if probe.group == "nominal"
    )
    assert not nominal.passed


def test_a_scene_is_rolled_out_with_the_seed_of_its_run_by_one_runner_for_all_runs():
    runners: list[RuleRunner] = []

    def runner(run):
        runners.append(RuleRunner(lambda shown: True, run))
        return runners[-1]

    corpus = make_corpus(case(1), case(2, run=1), runs=2)
    rerun = Rerun("new", [replace(run, seed=run.seed + 5) for run in corpus.runs], runner)
    for probe in probes_of(corpus)[:2]:
        assert rerun.answer(probe, 0).passed
        rerun.answer(probe, 3)
    rerun.close()
    assert len(runners) == runners[0].closed == 1
    assert [seed for _, seed in runners[0].calls] == [5, 8, 6, 9]


def test_runs_under_other_conditions_get_runners_of_their_own():
    runners = []
    Rerun(
        "new",
        [manifest(), manifest(min_distance=0.2)],
        lambda run: runners.append(run) or RuleRunner(lambda shown: True, run),
    )
    assert [run.min_distance for run in runners] == [0, 0.2]


@pytest.mark.parametrize(
    ("changes", "holds"),
    [({}, True), ({"repeats": 3}, False), ({"spec": '{"deterministic": false}'}, False)],
)
def test_records_of_a_stochastic_policy_are_no_baseline(changes, holds):
    assert records_hold(replace(make_corpus(), runs=[manifest(**changes)])) is holds
