"""An arm beside its control: shares, the difference, and its test."""

import pytest

from tests.doubles import failed, passed, rollout
from vlafuzz.lab.studies.result import Arm, arm, study_result
from vlafuzz.model.outcome import Outcome
from vlafuzz.worlds.tabletop.tasks import TASKS

STAGES = TASKS["pick-up"].stage_names
BROKE, UNFAIR = Outcome.error("broke"), Outcome.invalid("geometry", "too close")


def counted(*outcomes: Outcome, control: list[Outcome] | None = None) -> Arm:
    of_control = None if control is None else list(enumerate(control))
    return arm("pick-up", "idle", "mine", list(enumerate(outcomes)), of_control)


def paired(tried: list[tuple[int, Outcome]], *control: Outcome) -> Arm:
    return arm("pick-up", "idle", "mine", tried, list(enumerate(control)), paired=True)


def lost_after(*reached: str) -> Outcome:
    return Outcome.of((rollout(0.5, reached),), STAGES)


def test_a_stage_counts_where_it_was_reached_and_success_implies_all() -> None:
    result = counted(passed(), lost_after("grasp"), lost_after("grasp", "lift"), failed(), UNFAIR, BROKE)
    assert {name: (share.count, share.of) for name, share in result.stages.items()} == {
        "grasp": (3, 4), "lift": (2, 4), "success": (1, 4),
    }  # fmt: skip
    assert (result.invalid, result.errors, result.control) == (1, 1, None)
    assert result.success.low == pytest.approx(0.0456, abs=1e-4)


def test_of_several_rollouts_all_must_reach_a_stage() -> None:
    result = counted(Outcome.of((rollout(), rollout(0.4, ("grasp",))), STAGES))
    assert [share.count for share in result.stages.values()] == [1, 0, 0]


def test_independent_arms_differ_by_newcombes_interval_and_fishers_test() -> None:
    result = counted(*[passed()] * 2, *[failed()] * 8, BROKE, control=[*[passed()] * 8, *[failed()] * 2])
    assert result.control
    assert result.control.share == 0.8
    assert result.gain
    assert (result.gain.value, result.p) == (pytest.approx(-0.6), pytest.approx(0.0230, abs=1e-4))
    assert -0.9 < result.gain.low < -0.6 < result.gain.high < 0


def test_pairs_count_where_both_were_judged() -> None:
    tried = [(0, failed()), (1, passed()), (2, BROKE), (3, passed()), (4, failed())]
    result = paired(tried, passed(), passed(), passed(), failed(), BROKE)
    assert result.control
    assert (result.control.count, result.control.of) == (2, 3)
    assert result.gain
    assert (result.gain.value, result.p) == (0, 1.0)  # one is lost, one gained


def test_mutants_of_one_scene_are_one_pair_of_the_test() -> None:
    tried = [(origin, failed() if number else passed()) for origin in range(6) for number in range(3)]
    result = paired(tried, *[passed()] * 6)
    assert (result.success.count, result.success.of) == (6, 18)
    assert result.gain
    assert (result.gain.value, result.p) == pytest.approx((-2 / 3, 2 / 2**6))


@pytest.mark.parametrize("kind", [counted(control=[]), counted(passed(), control=[]), paired([])])
def test_without_a_judged_scene_on_both_sides_there_is_no_difference(kind: Arm) -> None:
    assert (kind.gain, kind.p) == (None, None)


def test_p_values_are_corrected_for_all_arms() -> None:
    tried = [(origin, failed()) for origin in range(6)]
    arms = [counted(passed()), *[paired(tried, *[passed()] * 6)] * 2]
    result = study_result("rq6", ["a: no room"], arms, ["so"])
    assert [row.p_holm for row in result.arms] == [None, pytest.approx(0.0625), pytest.approx(0.0625)]
    assert result.said()[0] == "Left out: a: no room."
    assert result.rows()[0]["net"] is None
