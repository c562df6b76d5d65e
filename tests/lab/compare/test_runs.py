from pathlib import Path

import pytest

from tests.doubles import manifest
from vlafuzz.errors import UsageError
from vlafuzz.lab.compare.compare import Job, jobs, stored
from vlafuzz.store.records import Run

STORE = Path("a.db")
ASKED = jobs(["random", "nsga2"], 2, 7)


def run(number: int, strategy: str, seed: int, status: str = "finished", **changes: object) -> Run:
    return Run(id=number, manifest=manifest(strategy=strategy, seed=seed, **changes), status=status, started="")  # type: ignore[arg-type]


def test_one_run_of_every_strategy_comes_before_the_second_of_any():
    assert ASKED == [("random", 7), ("nsga2", 7), ("random", 8), ("nsga2", 8)]


def test_what_is_over_is_kept_and_the_rest_is_to_do():
    there = [run(1, "random", 7), run(2, "nsga2", 7, "interrupted"), run(3, "feedback", 7)]
    known = stored(STORE, there, manifest(), ASKED)
    assert {job: kept.id for job, kept in known.items()} == {("random", 7): 1, ("nsga2", 7): 2}


def test_of_equal_runs_the_one_that_is_over_counts():
    there = [run(1, "random", 7, "failed"), run(2, "random", 7), run(3, "random", 7, "running")]
    assert stored(STORE, there, manifest(), ASKED)[Job("random", 7)].id == 2


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"budget": 9}, "run 5 has other conditions: budget 9, not 20"),
        ({"robot": "widowx"}, "run 5 has other conditions: robot widowx, not panda"),
        ({"packs": '[{"name": "a", "digest": "b", "folder": "c"}]'}, "other packs of objects"),
        ({"policy": "other"}, "run 5 has other conditions: policy other, not idle"),
        ({"operators_digest": "x"}, "run 5 has other conditions: other operators, or other ranges"),
        ({"commit": "x"}, "run 5 was made by another version than is installed: its commit differs"),
    ],
)
def test_runs_of_other_conditions_are_refused(change: dict[str, object], says: str):
    with pytest.raises(UsageError, match=says):
        stored(STORE, [run(5, "random", 7, **change)], manifest(), ASKED)


def test_a_comparison_that_is_complete_can_be_looked_at_with_a_later_version():
    there = [run(number, *job, commit="then") for number, job in enumerate(ASKED)]
    assert len(stored(STORE, there, manifest(commit="now"), ASKED)) == 4
    mixed = [*there[:3], run(9, *ASKED[3], commit="later")]
    with pytest.raises(UsageError, match="another version than run 0: its commit differs"):
        stored(STORE, mixed, manifest(), ASKED)


def test_runs_of_several_places_compare():
    there = [run(number, *job, place="there") for number, job in enumerate(ASKED[:2])]
    assert len(stored(STORE, there, manifest(place="here"), ASKED)) == 2
