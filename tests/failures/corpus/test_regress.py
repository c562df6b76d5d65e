"""When a policy counts as worse, which rollouts this takes, how the scenes are classified, and what is fixed."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import manifest
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import Planned, RuleRunner, flaky, probes
from vlafuzz.failures.corpus.controls import CONTROL, REGRESS, number_of
from vlafuzz.failures.corpus.pairs import Probe, probes as probes_of
from vlafuzz.failures.corpus.regress import REPEATS, Comparison, Recorded, Rerun, compare
from vlafuzz.model import Verdict
from vlafuzz.worlds.manipulation.jitter import jittered

RECORDED = Recorded("old as recorded")


def as_recorded(number: int, repeat: int) -> bool:
    return number % 5 > 0


def test_a_policy_that_does_as_recorded_is_not_worse_and_every_control_is_run_once():
    policy = Planned(as_recorded)
    result = compare(probes(), policy, RECORDED)
    assert (result.alarm, result.stopped, result.p_value, result.needed) == (False, "done", 1, 5)
    assert policy.calls == [(number, 0) for number in range(60)]
    assert Counter(scene.standing for scene in result.compared) == {"fails": 12, "passes": 48}
    assert (result.lost, result.tells) == (0, True)


def test_one_that_breaks_controls_is_worse_and_the_rest_is_spared():
    policy = Planned(lambda number, repeat: False)
    result = compare(probes(60, 10), policy, RECORDED)
    assert (result.alarm, result.stopped) == (True, "worse")
    assert (result.controls.worse, result.needed, len(policy.calls)) == (9, 0, 12)
    assert [scene.standing for scene in result.compared].count("not run") == 70 - 12
    assert "new is worse than old as recorded: 9 worse and 0 better of 12 controls" in result.verdict


def test_all_is_run_after_an_alarm_on_request_so_that_the_loss_is_not_overestimated():
    policy = Planned(lambda number, repeat: number % 5 > 1)
    result = compare(probes(60, 10), policy, RECORDED, whole=True)
    assert (result.alarm, result.stopped, result.tried) == (True, "done", 60)
    assert result.lost == pytest.approx(0.2)
    assert result.difference == pytest.approx((0.03, 0.35), abs=0.01)
    assert compare(probes(60, 10), policy, RECORDED).lost >= 0.2


def test_four_broken_controls_are_no_alarm():
    result = compare(probes(), Planned(lambda number, repeat: number % 5 > (number < 20)), RECORDED)
    assert (result.alarm, result.controls.worse, result.stopped) == (False, 4, "done")
    assert "1 more broken controls would make an alarm" in result.verdict


def test_scenes_that_were_selected_by_outcomes_never_raise_an_alarm():
    """Not even where a baseline that is rolled out passes in all of them."""
    policy = Planned(lambda number, repeat: number < 20 and number % 5 > 0)
    baseline = Planned(lambda number, repeat: number >= 20 or number % 5 > 0, name="old")
    result = compare(probes(20, 200), policy, baseline)
    assert (result.alarm, result.p_value, result.tally("failing").worse) == (False, 1, 200)


def passing(most: int) -> list[Probe]:
    return [replace(probe, passed=number < most) for number, probe in enumerate(probes(40))]


@pytest.mark.parametrize(
    ("scenes", "verdict"),
    [
        (probes(4), "4 of 4 controls could be judged; an alarm takes 5 or more"),
        (passing(2), "old as recorded passes 2 of 40 controls, only these can break, and an alarm takes 5 or more"),
    ],
    ids=["fewer controls than an alarm takes", "fewer controls pass than an alarm takes"],
)
def test_where_no_alarm_is_possible_there_is_no_verdict_whatever_else_breaks(scenes, verdict):
    result = compare(scenes, Planned(lambda number, repeat: False), RECORDED)
    assert (result.alarm, result.tells, result.verdict) == (False, False, f"cannot tell: {verdict}")


def test_the_verdict_says_where_too_few_are_left_to_break_for_an_alarm():
    result = compare(passing(5), Planned(lambda number, repeat: number in (0, 1, 9)), RECORDED, whole=True)
    assert result.verdict.endswith("an alarm would take 4 more, and only 2 others could break")


def test_selected_scenes_are_repeated_after_the_controls_and_judged_by_what_is_mostly_done():
    policy = Planned(lambda number, repeat: number >= 10 and (number + repeat) % 3 > 0)
    result = compare(probes(10, 3), policy, Recorded("old"), alpha=1e-9)
    assert Counter(policy.calls[10:]) == {(number, r): 1 for number in range(10, 13) for r in range(3)}
    assert [scene.standing for scene in result.of("failing")] == ["better"] * 3
    assert (result.tally("failing").policy.count, result.tally("failing").policy.of) == (6, 9)


def test_errors_and_unfair_scenes_are_counted_apart_and_never_worse():
    def rule(number: int, repeat: int) -> Verdict | bool:
        return Verdict.ERROR if number % 20 == 1 else Verdict.INVALID if number % 10 == 2 else number % 5 > 0

    result = compare(probes(), Planned(rule), RECORDED)
    standings = Counter(scene.standing for scene in result.compared)
    assert (standings["error"], standings["invalid"], standings["worse"]) == (3, 6, 0)
    assert (result.controls.worse, result.controls.baseline.of, result.tells) == (0, 51, True)
    assert {scene.detail for scene in result.compared if scene.standing == "error"} == {"policy: connect"}


@pytest.mark.parametrize("broken", ["policy", "baseline"])
def test_a_side_that_only_breaks_is_given_up_early_without_a_verdict(broken):
    wreck = Planned(lambda number, repeat: Verdict.ERROR)
    fine = Planned(lambda number, repeat: True)
    sides = (wreck, fine) if broken == "policy" else (fine, wreck)
    result = compare(probes(), *sides)
    assert (result.stopped, result.tells, result.alarm, len(wreck.calls)) == ("unjudged", False, False, 10)
    assert result.verdict.startswith("cannot tell: 0 of 10 controls could be judged")


def test_a_verdict_needs_half_of_the_controls():
    result = compare(probes(), Planned(lambda n, _: Verdict.INVALID if n % 3 else n % 5 > 0), RECORDED)
    assert (result.stopped, result.lacking, result.tells) == ("done", 0, False)


@pytest.mark.parametrize(("errors", "tells"), [(4, True), (5, False)])
def test_a_verdict_needs_the_controls_that_could_have_made_an_alarm(errors: int, tells: bool):
    """Those that the baseline fails could not."""
    lost = {number for number in range(60) if number % 5 == 0} | {5 * n + 1 for n in range(errors)}
    policy = Planned(lambda number, repeat: Verdict.ERROR if number in lost else number % 5 > 0)
    result = compare(probes(), policy, RECORDED)
    assert (result.stopped, result.lacking, result.tells) == ("done", errors, tells)
    said = "43 of 60 controls could be judged; 5 could not be, and 5 that break would make an alarm"
    assert (result.verdict == f"cannot tell: {said}") is not tells


def test_every_scene_of_a_corpus_is_probed_once_controls_first():
    scenes = probes_of(make_corpus(case(0), case(1), case(1), controls=2))
    groups, passed = ("control", "control", "failing", "failing"), (False, True, False, False)
    assert [(probe.group, probe.passed) for probe in scenes] == list(zip(groups, passed, strict=True))
    assert scenes[2].what == "light: fails from intensity × 0.25 on"


@pytest.fixture
def rerun() -> tuple[Rerun, list[RuleRunner]]:
    """A policy in the scenes of two runs with seeds 0 and 1, and the runners that it makes."""
    runners: list[RuleRunner] = []

    def runner(run):
        runners.append(RuleRunner(lambda shown: True, run))
        return runners[-1]

    return Rerun("new", [manifest(), manifest(seed=1)], runner), runners


def test_one_runner_serves_all_runs_under_the_same_conditions(rerun):
    side, runners = rerun
    for probe in probes_of(make_corpus(case(1), case(2, run=1), runs=2)):
        assert next(side.answers([(probe, 0)])).passed
    side.close()
    assert len(runners) == runners[0].closed == 1


def test_every_rollout_has_a_seed_of_its_own_that_neither_triage_nor_export_uses(rerun):
    side, (runner, *_) = rerun
    for probe in probes_of(make_corpus(case(1), case(2), controls=40)):
        for repeat in range(1 if probe.group == "control" else REPEATS):
            next(side.answers([(probe, repeat)]))
    seeds = [seed for _, seed in runner.calls]
    assert len(set(seeds)) == len(seeds) == 40 + 2 * REPEATS
    assert min(seeds[:40]) >= CONTROL
    assert min(seeds[40:]) >= REGRESS > max(seeds[:40])


def test_a_run_adds_its_seed(rerun):
    side, (runner, *_) = rerun
    probe = probes_of(make_corpus())[0]
    list(side.answers([(probe, 0), (replace(probe, run=1), 0)]))
    (_, first), (_, second) = runner.calls
    assert second - first == 1


def test_a_control_is_run_as_it_is_and_another_scene_jittered_anew_in_each_repeat(rerun):
    side, (runner, *_) = rerun
    control, failing = probes_of(make_corpus(controls=1))[:2]
    list(side.answers([(control, 0), (failing, 0), (failing, 1)]))
    (shown, seed), *around = runner.calls
    assert (shown, seed) == (control.scene, number_of(control.scene))
    assert [scene for scene, _ in around] == [jittered(failing.scene, seed) for _, seed in around]
    assert len({failing.scene, *(scene for scene, _ in around)}) == 3


def test_runs_under_other_conditions_get_runners_of_their_own():
    asked = []

    def runner(run):
        asked.append(run.value("min_distance"))
        return RuleRunner(lambda shown: True, run)

    Rerun("new", [manifest(), manifest(world={"min_distance": 0.2})], runner)
    assert asked == [0, 0.2]


CONTROLS, FAILING = 20, 10  # failing scenes have the numbers 20 to 29


def compared(rule, baseline=RECORDED) -> Comparison:
    return compare(probes(CONTROLS, FAILING), Planned(rule), baseline)


def repaired(number: int, repeat: int) -> bool:
    return number % 5 > 0 or number >= CONTROLS


def as_before(number: int, repeat: int) -> bool:
    return number < CONTROLS and number % 5 > 0


def elsewhere(number: int, repeat: int) -> bool:
    """Repaired in the controls, where the corpus has no failing scene."""
    return number < CONTROLS


NOTHING = "nothing is shown to be fixed: "
RULES = {
    "repaired": (repaired, "failures are fixed: ", 10, "9.3e-10"),
    "as before": (as_before, NOTHING, 0, "1"),
    "repaired elsewhere": (elsewhere, NOTHING, 0, "1"),
    # Two that fail once in three show nothing.
    "mostly passes two": (lambda n, repeat: as_before(n, repeat) or (n in (20, 21) and repeat > 0), NOTHING, 2, "1"),
}


@pytest.mark.parametrize("rule", RULES)
def test_what_is_fixed_is_counted_and_said_where_it_is_shown(rule):
    rule, says, fixed, p_value = RULES[rule]
    result = compared(rule)
    assert (result.fixed.changed, result.fixed.of) == (fixed, 10)
    assert (result.fixed.shown, result.alarm) == (fixed == 10, False)
    assert result.changes == f"{says}{fixed} of 10 failing scenes fixed (p = {p_value})"


def test_what_was_not_judged_does_not_count():
    result = compared(lambda number, repeat: Verdict.ERROR if number >= 25 else repaired(number, repeat))
    assert result.fixed.of == 5
    nothing = compare(probes(CONTROLS), Planned(as_before), RECORDED)
    assert nothing.changes == ""


def test_against_a_baseline_that_is_rolled_out_it_is_a_sign_test():
    old = Planned(as_before, name="old")
    result = compared(repaired, old)
    assert (result.fixed.changed, result.fixed.of) == (10, 10)
    assert result.fixed.p_value == pytest.approx(2.0**-30)
    back = compare(probes(CONTROLS, FAILING), Planned(as_before), Planned(repaired, name="old"))
    assert (back.fixed.changed, back.fixed.of, back.fixed.p_value) == (0, 0, 1)


@pytest.mark.parametrize("rate", [0.5, 0.7])
def test_a_policy_that_still_mostly_fails_is_hardly_ever_said_to_fix(rate: float):
    rng = np.random.default_rng(0)
    shown = [compare(probes(0, 20), flaky(rate, rng), RECORDED).fixed.shown for _ in range(300)]
    assert np.mean(shown) <= 0.07
