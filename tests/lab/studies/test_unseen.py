"""Seen against unseen objects."""

import pytest

from vlafuzz.common.statistics import Share
from vlafuzz.lab.studies.stages import Reached, Standing
from vlafuzz.lab.studies.unseen import difference, paired_tests, transfers


def standing(*counts: int, of: int = 10, policy: str = "a", task: str = "pick-up") -> Standing:
    shares = [Share.of_counts(count, of) for count in counts]
    stages = [Reached(*vars(row).values(), stage=f"stage {number}") for number, row in enumerate(shares)]
    return Standing(
        task=task,
        policy=policy,
        confounders=None,
        judged=of,
        invalid=0,
        errors=0,
        progress=0.5,
        stopped=False,
        stages=tuple(stages),
    )


def test_a_transfer_rate_is_the_share_of_those_that_came_so_far() -> None:
    assert transfers(standing(8, 4, 1)) == (0.8, 0.5, 0.25)
    assert transfers(standing(0, 0, 0)) == (0.0, None, None)


def test_a_difference_is_relative_to_success_with_seen_objects() -> None:
    result = difference(standing(9, 9, 8), standing(8, 4, 2))
    assert (result.relative, result.points) == (pytest.approx(-0.75), pytest.approx(-0.6))
    assert result.low is not None
    assert result.high is not None
    assert -1 < result.low < -0.6 < result.high < 0


def test_what_nobody_passed_has_no_relative_difference_and_no_interval() -> None:
    result = difference(standing(0, 0, 0), standing(0, 0, 0))
    assert (result.relative, result.points, result.low) == (None, 0.0, None)


def test_three_policies_are_tested_and_two_are_not() -> None:
    pairs = [("a", 8, 4), ("b", 6, 3), ("c", 9, 7)]
    result = [difference(standing(was, policy=name), standing(now, policy=name)) for name, was, now in pairs]
    (test,) = paired_tests(result)
    assert (test.task, test.policies) == ("pick-up", 3)
    assert test.t == pytest.approx(-0.3 / (0.1 / 3**0.5))
    assert test.d == pytest.approx(-3.0)
    assert test.p == pytest.approx(0.0351, abs=1e-4)
    assert paired_tests(result[:2]) == []


def test_over_all_tasks_the_means_of_each_policy_are_compared() -> None:
    result = [
        difference(standing(was, policy=name, task=task), standing(now, policy=name, task=task))
        for task in ("pick-up", "put-on")
        for name, was, now in (("a", 8, 4), ("b", 6, 3), ("c", 9, 7))
    ]
    assert [row.task for row in paired_tests(result)] == ["pick-up", "put-on", "all"]
    assert paired_tests(result)[0].t == pytest.approx(paired_tests(result)[2].t)
