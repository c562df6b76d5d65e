import numpy as np
import pytest

from tests.doubles import manifest
from vlafuzz.lab.compare.comparison import curves, spread
from vlafuzz.lab.compare.figures import (
    CountedRun,
    Failure,
    coverage_inverted_distance,
    figures,
    qd_score,
    quality,
    sparseness,
    union,
)
from vlafuzz.model.outcome import Verdict
from vlafuzz.store.records import Run


def failure(x: float, cell: str = "a", spent: int = 1, worth: float = 0.5) -> Failure:
    vector = np.array([x, 0.0])
    return Failure(digest=str(x), cell=cell, severity=1.0, quality=worth, spent=spent, vector=vector)


def counted(*failures: Failure, passed: int = 20, invalid: int = 0) -> CountedRun:
    run = Run(
        id=1, manifest=manifest(strategy="mine", seed=4), status="finished", started="", seconds=9.0, search_seconds=0.9
    )
    verdicts = dict.fromkeys(Verdict, 0) | {Verdict.PASSED: passed, Verdict.INVALID: invalid}
    return CountedRun(run=run, rollouts=20, rollout_seconds=0.0, verdicts=verdicts, rejected=4, failures=failures)


def test_a_failure_in_the_nominal_scene_before_anything_was_achieved_is_worth_one():
    assert quality(0.0, 0.0, 10) == 1.0
    assert quality(5.0, 0.5, 10) == 0.5
    assert quality(12.0, 1.0, 10) == 0.0


def test_qd_score_is_the_best_of_every_cell_added_up():
    assert qd_score([failure(0, "a", worth=0.2), failure(1, "a", worth=0.6), failure(2, "b")]) == 1.1
    assert qd_score([]) == 0.0


def test_cid_is_the_mean_distance_from_what_there_is_to_the_nearest_that_was_found():
    reference = [failure(0.0), failure(3.0), failure(10.0)]
    assert coverage_inverted_distance([failure(0.0), failure(9.0)], reference) == pytest.approx(4 / 3)
    assert coverage_inverted_distance(reference, reference) == 0.0
    assert coverage_inverted_distance([], reference) is None


def test_sparseness_is_the_mean_distance_to_the_nearest_other_failure():
    assert sparseness([failure(0.0), failure(1.0), failure(5.0)]) == pytest.approx((1 + 1 + 4) / 3)
    assert sparseness([failure(0.0)]) is None


def test_of_every_cell_the_union_has_the_most_central_failure():
    runs = [counted(failure(0.0), failure(0.4, "b")), counted(failure(0.1), failure(0.5))]
    central = union(runs)
    assert {cell: middle.vector[0] for cell, middle in central.items()} == {"a": 0.1, "b": 0.4}


def test_the_figures_of_a_run_are_those_that_one_counts_by_hand():
    failures = [failure(0.01 * number, "ab"[number % 2], spent=number + 3) for number in range(10)]
    numbers = figures(counted(*failures, invalid=5), union([counted(*failures, failure(0.2, "c"))]))
    assert (numbers["strategy"], numbers["seed"], numbers["failures"], numbers["cells"]) == ("mine", 4, 10, 2)
    assert (numbers["first_failure"], numbers["tenth_failure"]) == (3, 12)
    assert (numbers["coverage"], numbers["valid_share"], numbers["rejected"]) == (pytest.approx(2 / 3), 0.8, 4)
    assert (numbers["search_seconds"], numbers["search_share"]) == (0.9, pytest.approx(0.1))
    assert (numbers["store_seconds"], numbers["store_share"]) == (None, None)


def test_a_run_without_failures_has_no_distances():
    numbers = figures(counted(), {})
    none = ("cid", "sparseness", "severity", "first_failure", "coverage", "causes")
    assert [numbers[name] for name in none] == [None] * 6
    assert numbers["qd_score"] == 0.0


def test_a_curve_goes_from_nothing_to_the_whole_budget_over_the_repeats():
    runs = [counted(failure(0.1, "a", 1), failure(0.2, "a", 2)), counted(failure(0.3, "b", 4))]
    failures, cells = curves("mine", runs, 4)
    assert failures.rollouts == (0, 1, 2, 3, 4)
    assert failures.median == (0, 0.5, 1, 1, 1.5)
    assert cells.median == (0, 0.5, 0.5, 0.5, 1)
    assert (cells.low[2], cells.high[2]) == (0.25, 0.75)
    long, _ = curves("mine", runs, 300)
    assert (len(long.rollouts), long.rollouts[-1]) == (51, 300)


def test_what_most_runs_have_none_of_has_no_median():
    late, early = 1e300, -1e300
    assert spread([1, 2, None], late).median == 2.0
    assert spread([1, 2, None], late).high is None
    assert spread([1, None, None], late) == spread([5, None, None], late)
    assert spread([1, 2, None], early).median == 1.0
    assert spread([1, 2, None], early).low is None


def test_what_has_no_direction_is_of_those_that_have_it():
    assert spread([None, 1, 2, 3]).median == 2.0
    assert spread([None, None]).median is None
