"""Against examples worked by hand, and what simulation says."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import stats

from vlafuzz.common.statistics import (
    SignedRank,
    holm,
    mean_estimate,
    mean_ratio,
    newcombe,
    pairs_needed,
    sequential_interval,
    sign_p,
    signed_rank,
    smallest_p,
    wilson,
)


def test_the_signed_rank_test_counts_all_changes_of_signs():
    test = signed_rank([5, 7, 9, 12, 1], [4, 5, 6, 8, 6])  # differences of 1, 2, 3, 4, -5
    assert (test.more, test.fewer) == (4, 1)
    assert test.effect == pytest.approx((10 - 5) / 15)
    assert test.p == pytest.approx(20 / 32)  # 10 of the 32 sums of negative ranks are 5 or less


def test_pairs_of_equal_values_count_for_neither():
    assert (signed_rank([3, 3, 3], [3, 3, 3]).p, signed_rank([9], [3]).p) == (1.0, 1.0)
    assert signed_rank([3, 3, 4, 5, 6], [3, 3, 3, 3, 3]) == SignedRank(3, 0, 1.0, 2 / 8)


def test_a_run_that_never_fails_ranks_beyond_all_others():
    test = signed_rank([1, 2, 3, math.inf, math.inf], [9, 9, 9, 9, math.inf])
    assert (test.more, test.fewer, test.effect) == (1, 3, pytest.approx(-4 / 14))


@pytest.mark.parametrize("pairs", [8, 40])
def test_without_ties_it_is_wilcoxons_test(pairs: int):
    ours, theirs = np.random.default_rng([0, pairs]).normal([[0.4], [0]], 1, (2, pairs))
    assert signed_rank(ours, theirs).p == pytest.approx(stats.wilcoxon(ours, theirs).pvalue)


def test_what_few_pairs_cannot_tell():
    assert smallest_p(5) == 0.0625
    assert smallest_p(1) == 1.0
    assert [pairs_needed(tests, 0.05) for tests in (1, 2, 14)] == [6, 7, 10]


def test_holm_multiplies_the_smallest_by_their_number_and_never_changes_their_order():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_a_ratio_needs_something_to_divide_by():
    assert mean_ratio([2, 4], [1, 2]).value == 2.0
    assert mean_ratio([1, 2], [0, 0]) is None
    assert mean_ratio([math.inf, 1], [1, 1]) is None


def test_the_interval_of_a_ratio_ignores_how_much_seeds_differ():
    known = mean_ratio([2.1, 9.9, 40.2, 159.0], [1.0, 5.0, 20.0, 80.0])
    assert 1.9 < known.low < 2.0 < known.high < 2.1


@pytest.mark.parametrize(
    ("ours", "theirs"), [([3, 4], [0, 1]), ([0, 4], [1, 1]), ([3], [1]), ([6, 9], [2, 3]), ([0, 0], [1, 2])]
)
def test_an_interval_has_no_bounds_where_one_pair_decides_or_all_agree(ours: list[int], theirs: list[int]):
    assert mean_ratio(ours, theirs).low is None
    assert mean_ratio(ours, theirs).high is None


def test_the_interval_of_a_ratio_by_hand():
    # Without one pair: 14/7, 11/8, 9/9. With 2 degrees of freedom t is 4.303.
    logs = np.log([14 / 7, 11 / 8, 9 / 9])
    half = 4.302653 * 2 * logs.std(ddof=1) / math.sqrt(3)
    known = mean_ratio([3, 6, 8], [5, 4, 3])
    assert (known.low, known.high) == pytest.approx((17 / 12 * math.exp(-half), 17 / 12 * math.exp(half)))


def test_an_estimate_in_words():
    assert str(mean_estimate([4, 5, 6])) == "5 (3.04 to 8.23)"
    assert str(mean_estimate([4, 4])) == "4 (no bound)"


@pytest.mark.parametrize("pairs", [5, 8, 20])
@pytest.mark.parametrize("kind", ["normal", "counts", "mostly zero", "waiting"])
def test_the_intervals_of_paired_runs_contain_the_truth_as_often_as_they_say(kind: str, pairs: int):
    rng = np.random.default_rng([0, 3, pairs])
    values = {
        "normal": lambda mean: mean * rng.normal(1, 0.1, pairs),
        "counts": lambda mean: rng.poisson(mean, pairs),
        "mostly zero": lambda mean: rng.poisson(mean, pairs) * (rng.random(pairs) < 0.4),
        "waiting": lambda mean: rng.geometric(1 / mean, pairs),
    }[kind]
    samples = [(values(6).tolist(), values(4).tolist()) for _ in range(600)]
    known = [mean_ratio(*sample) for sample in samples]
    wrong = sum(bool(one and one.low) and not one.low <= 1.5 <= one.high for one in known)
    assert wrong <= 45  # 30 expected; their standard deviation is 5


@pytest.mark.parametrize("rate", [0.3, 0.45, 0.5])
def test_a_sequential_bound_is_wrong_in_at_most_one_of_twenty_samples_that_stop_when_it_suits(rate: float):
    rng = np.random.default_rng(round(100 * rate))
    wrong = 0
    for _ in range(1000):
        failures = np.cumsum(rng.random(40) < rate)
        bounds = (sequential_interval(int(k), n) for n, k in enumerate(failures, start=1))
        wrong += any(low > rate for low, _ in bounds)
    assert wrong <= 65  # 50 expected at most; their standard deviation is 7


def test_five_of_five_put_the_sequential_bound_above_one_half_and_four_do_not():
    assert sequential_interval(4, 4).low < 0.5 < sequential_interval(5, 5).low
    assert sequential_interval(0, 5).high < 0.5 < sequential_interval(0, 4).high
    assert sequential_interval(0, 0) == (0, 1)


@pytest.mark.parametrize(("k", "n"), [(1, 0), (3, 2), (-1, 2)])
def test_counts_that_cannot_be_have_no_sequential_interval(k: int, n: int):
    with pytest.raises(ValueError, match=f"{k} of {n} cases"):
        sequential_interval(k, n)


@given(st.integers(0, 70), st.integers(0, 70))
def test_a_sequential_interval_holds_the_share_and_mirrors_that_of_the_other_outcome(k: int, others: int):
    low, high = sequential_interval(k, k + others)
    assert 0 <= low <= (k / (k + others) if k + others else 0.5) <= high <= 1
    assert sequential_interval(others, k + others) == pytest.approx((1 - high, 1 - low))


@pytest.mark.parametrize(("worse", "better"), [(0, 0), (7, 1), (39, 59), (900, 700)])
def test_the_sign_test_is_scipys_binomial_one(worse: int, better: int):
    expected = stats.binomtest(worse, worse + better, alternative="greater").pvalue if worse + better else 1.0
    assert float(sign_p(worse, better)) == pytest.approx(expected, rel=1e-9)


def test_wilson_agrees_with_the_published_example_and_knows_nothing_of_no_cases():
    low, high = wilson(1, 29)  # Newcombe 1998, Table I: 1 of 29 is 0.0061 to 0.1718
    assert (round(low, 4), round(high, 4)) == (0.0061, 0.1718)
    assert wilson(0, 0) == (0.0, 1.0)


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
def test_the_interval_of_a_difference_is_the_published_one(counts: tuple[int, int, int, int], low: float, high: float):
    assert newcombe(*counts) == pytest.approx((low, high), abs=5e-5)
