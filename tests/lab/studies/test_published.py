"""The paper's figures agree with each other where they should, and differ where they are known to."""

import pytest

from vlafuzz.common.assets import published_dir
from vlafuzz.lab.studies import published
from vlafuzz.worlds.tabletop.tasks import TASKS

PASSED = {(row.task, row.policy): row.passed for row in published.rows(published.Passed)}
MUTATED = {(row.study, row.task, row.policy): row for row in published.rows(published.Mutated)}


@pytest.mark.parametrize("path", sorted(published_dir().glob("*.csv")), ids=lambda path: path.stem)
def test_every_file_names_its_source(path) -> None:
    assert path.read_text().startswith("# Source: ")


def test_coverage_has_three_sizes_of_every_task() -> None:
    rows = {(row.task, row.scenes) for row in published.rows(published.Coverage)}
    assert rows == {(task, scenes) for task in TASKS for scenes in (10, 100, 1000)}
    assert len(published.rows(published.Coverage)) == 12


def test_seven_policies_passed_1434_scenes() -> None:
    assert len(PASSED) == 28
    assert sum(PASSED.values()) == 1434
    by_task = [sum(passed for (of, _), passed in PASSED.items() if of == task) for task in TASKS]
    assert by_task == [895, 423, 79, 37]


def test_a_mutation_starts_from_what_was_passed() -> None:
    for (_, task, policy), row in MUTATED.items():
        if "all" not in (task, policy):
            assert row.default == PASSED[task, policy]


def test_the_mean_of_what_was_passed_is_the_printed_mean() -> None:
    for row in published.rows(published.Success):
        if row.policy == "mean":
            mean = sum(PASSED[task, policy] for task, policy in PASSED if task == row.task) / 7000
            assert min(abs(mean - share) for share in (row.share, row.as_well) if share) < 1e-3


@pytest.mark.parametrize("study", ["rq3", "rq4"])
def test_a_total_that_is_printed_wrong_has_the_right_one_beside_it(study: str) -> None:
    row = MUTATED[study, "all", "rt-1-58k"]
    assert row.default == 491
    assert row.right_default == sum(PASSED[task, "rt-1-58k"] for task in TASKS) == 391


def test_the_camera_total_that_is_printed_wrong_is_the_sum_of_its_tasks() -> None:
    row = MUTATED["rq4", "all", "rt-1-58k"]
    parts = [MUTATED["rq4", task, "rt-1-58k"].mutated or 0.0 for task in ("pick-up", "move-near")]
    assert (row.mutated, row.right_mutated) == (39.3, pytest.approx(sum(parts)))
    assert row.right_kept == pytest.approx(sum(parts) / 391, abs=5e-4)
    assert row.kept == pytest.approx(sum(parts) / 491, abs=5e-4)
