from pathlib import Path

import pytest

from tests.doubles import failed, manifest, passed, trial
from vlafuzz.campaign.results import beside_random
from vlafuzz.common.statistics import newcombe
from vlafuzz.store.store import Store


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield opened


def run(store: Store, fails: int, passes: int, *, first: int = 0, **about: object) -> int:
    number = store.begin(manifest(**about))
    for index in range(fails + passes):
        store.add(number, trial(first + index, failed() if index < fails else passed()))
    return number


# Newcombe 1998, table II, method 10
@pytest.mark.parametrize(
    ("counts", "low", "high"),
    [
        ((56, 70, 48, 80), 0.0524, 0.3339),
        ((9, 10, 3, 10), 0.1705, 0.8090),
        ((10, 10, 0, 20), 0.6791, 1.0000),
        ((10, 10, 0, 10), 0.6075, 1.0000),
        ((5, 56, 0, 29), -0.0381, 0.1926),
    ],
)
def test_the_interval_is_the_published_one(counts: tuple[int, int, int, int], low: float, high: float):
    assert newcombe(*counts) == pytest.approx((low, high), abs=5e-5)


def test_a_run_stands_beside_the_random_ones_of_its_store(store: Store):
    run(store, 10, 90)
    guided = run(store, 40, 60, first=200, strategy="nsga2", budget=7, seed=3)
    run(store, 10, 30, first=400, seed=1)
    beside = beside_random(store, guided)
    assert (beside.failed, beside.judged, beside.random_failed, beside.random_judged) == (40, 100, 20, 140)
    assert beside.difference == pytest.approx(0.4 - 20 / 140)
    assert beside.tells


def test_two_shares_of_few_scenes_cannot_be_told_apart(store: Store):
    run(store, 2, 8)
    beside = beside_random(store, run(store, 4, 6, first=100, strategy="nsga2"))
    assert (beside.difference, beside.tells) == (pytest.approx(0.2), False)


@pytest.mark.parametrize(
    "change",
    [{"task": "put-on"}, {"policy": "other"}, {"operators_digest": "o"}, {"repeats": 2}, {"commit": "c"}],
    ids=str,
)
def test_a_random_run_of_something_else_is_no_measure(store: Store, change: dict[str, object]):
    run(store, 2, 8, **change)
    beside = beside_random(store, run(store, 4, 6, first=100, strategy="nsga2"))
    assert (beside.random_judged, beside.difference, beside.tells) == (0, None, False)


def test_a_scene_counts_once_by_its_last_verdict(store: Store):
    first = run(store, 3, 0)
    again = run(store, 0, 3)
    assert store.judged([first]) == (3, 3)
    assert store.judged([first, again]) == (0, 3)
    assert store.judged([]) == (0, 0)
