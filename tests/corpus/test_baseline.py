from pathlib import Path

import pytest

from tests.doubles import failed, manifest, passed, trial
from vlafuzz.corpus.baseline import beside_random, newcombe
from vlafuzz.corpus.store import Corpus


@pytest.fixture
def corpus(tmp_path: Path):
    with Corpus.open(tmp_path / "a.db", "write") as opened:
        yield opened


def run(corpus: Corpus, fails: int, passes: int, *, first: int = 0, **about: object) -> int:
    number = corpus.begin(manifest(**about))
    for index in range(fails + passes):
        corpus.add(number, trial(first + index, failed() if index < fails else passed()))
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


def test_a_run_stands_beside_the_random_ones_of_its_store(corpus: Corpus):
    run(corpus, 10, 90)
    guided = run(corpus, 40, 60, first=200, strategy="nsga2", budget=7, seed=3)
    run(corpus, 10, 30, first=400, seed=1)
    beside = beside_random(corpus, guided)
    assert (beside.failed, beside.judged, beside.random_failed, beside.random_judged) == (40, 100, 20, 140)
    assert beside.difference == pytest.approx(0.4 - 20 / 140)
    assert beside.tells


def test_two_shares_of_few_scenes_cannot_be_told_apart(corpus: Corpus):
    run(corpus, 2, 8)
    beside = beside_random(corpus, run(corpus, 4, 6, first=100, strategy="nsga2"))
    assert (beside.difference, beside.tells) == (pytest.approx(0.2), False)


@pytest.mark.parametrize(
    "change",
    [{"task": "put-on"}, {"subject": "other"}, {"operators_digest": "o"}, {"repeats": 2}, {"commit": "c"}],
    ids=str,
)
def test_a_random_run_of_something_else_is_no_measure(corpus: Corpus, change: dict[str, object]):
    run(corpus, 2, 8, **change)
    beside = beside_random(corpus, run(corpus, 4, 6, first=100, strategy="nsga2"))
    assert (beside.random_judged, beside.difference, beside.tells) == (0, None, False)


def test_a_scene_counts_once_by_its_last_verdict(corpus: Corpus):
    first = run(corpus, 3, 0)
    again = run(corpus, 0, 3)
    assert corpus.judged([first]) == (3, 3)
    assert corpus.judged([first, again]) == (0, 3)
    assert corpus.judged([]) == (0, 0)
