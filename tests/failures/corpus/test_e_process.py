"""The test's guarantees: false alarms and power."""

from itertools import accumulate

import numpy as np
import pytest
from scipy.integrate import quad

from vlafuzz.common.statistics import wilson
from vlafuzz.failures.corpus.e_process import SignTest, wealth


def alarms(worse: float, pairs: int, runs: int, alpha: float = 0.05) -> float:
    """Share of runs with an alarm, where a discordant pair is worse with that probability."""
    drawn = np.random.default_rng(0).random((runs, pairs)) < worse
    table = np.array(
        [[wealth(w, b) if w + b <= pairs else 0 for b in range(pairs + 1)] for w in range(pairs + 1)]
    )
    counts = np.cumsum(drawn, axis=1)
    paths = table[counts, np.arange(1, pairs + 1) - counts]
    return float(np.mean(paths.max(axis=1) >= 1 / alpha))


@pytest.mark.parametrize("alpha", [0.2, 0.05, 0.01])
def test_false_alarms_stay_below_alpha_however_long_one_looks(alpha):
    runs = 10_000
    assert wilson(round(alarms(0.5, 120, runs, alpha) * runs), runs).low <= alpha


def test_a_policy_that_is_mostly_worse_is_found_out():
    assert alarms(0.9, 20, 2000) > 0.9
    assert alarms(0.75, 60, 2000) > 0.9


def test_a_better_policy_hardly_raises_an_alarm():
    assert alarms(0.3, 120, 2000) < 0.02


@pytest.mark.parametrize(("worse", "better"), [(0, 0), (5, 0), (3, 2), (0, 7), (12, 4)])
def test_the_next_pair_does_not_change_the_wealth_on_average(worse, better):
    after = (wealth(worse + 1, better) + wealth(worse, better + 1)) / 2
    assert after == pytest.approx(wealth(worse, better))


@pytest.mark.parametrize(("worse", "better"), [(0, 0), (4, 0), (3, 2), (9, 5)])
def test_the_wealth_is_that_of_the_stated_bets(worse, better):
    def bet(p: float) -> float:
        return (2 * p) ** worse * (2 - 2 * p) ** better

    spread = 2 * quad(bet, 0.5, 1)[0]
    assert wealth(worse, better) == pytest.approx(0.5 * bet(0.62) + 0.5 * spread)


def test_eight_of_eight_make_an_alarm_at_five_percent_and_more_where_some_are_better():
    assert [SignTest(0.05, 0, better).needed for better in range(4)] == [8, 11, 13, 15]
    assert SignTest(0.01).needed == 11


def test_an_alarm_is_not_taken_back():
    test = SignTest(0.05)
    p_values = []
    for worse in [True] * 8 + [False] * 8:
        test.see(worse=worse)
        p_values.append(test.p_value)
    assert test.alarm
    assert p_values == list(accumulate(p_values, min))
    assert (test.worse, test.better) == (8, 8)
