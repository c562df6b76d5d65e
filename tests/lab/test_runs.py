"""Which runs of a store a comparison or a study takes."""

from pathlib import Path

import pytest

from tests.doubles import manifest, passed, scene
from vlafuzz.errors import UsageError
from vlafuzz.lab.runs import stored
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield opened


def test_a_run_that_is_over_is_taken_before_one_that_ended_early(store: Store) -> None:
    for status in ("finished", "interrupted"):
        store.finish(store.begin(manifest()), status, 1.0)
    result = stored(store, manifest(), "--out")
    assert result
    assert (result.id, result.status) == (1, "finished")


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 9}, {"budget": 9}, {"robot": "widowx"}, {"policy": "other"}, {"operators_digest": "x"},
        {"packs": '[{"name": "a", "digest": "b", "folder": "c"}]'}, {"strategy": "nsga2"},
    ],
)  # fmt: skip
def test_a_run_of_other_conditions_is_another_one(store: Store, change: dict[str, object]) -> None:
    store.begin(manifest())
    assert stored(store, manifest(**change), "--out") is None  # type: ignore[arg-type]


def test_batches_and_places_may_differ(store: Store) -> None:
    store.begin(manifest(batch=3))
    assert stored(store, manifest(batch=16, place="elsewhere"), "--out")


def test_a_run_of_another_version_is_refused(store: Store) -> None:
    store.begin(manifest())
    with pytest.raises(UsageError, match="another version than is installed: its commit") as caught:
        stored(store, manifest(commit="abc"), "--out")
    assert "another --out" in str(caught.value.hint)


def test_a_run_of_given_scenes_is_of_these_or_of_the_first_of_them(store: Store) -> None:
    given = [scene(x=0.001 * number) for number in range(3)]
    run = store.begin(manifest())
    for number, shown in enumerate(given[:2]):
        store.add(run, Trial(proposal=number, scene=shown, outcome=passed(), severity=0.0))
    assert stored(store, manifest(), "--out", given)
    assert stored(store, manifest(), "--out", given[1:]) is None
