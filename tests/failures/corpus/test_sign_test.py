"""The test's guarantees, and the loss that it can notice, as is said before anything is run."""

from itertools import accumulate

import numpy as np
import pytest
from scipy.stats import binom

from tests.failures.corpus.sides import flaky, probes
from vlafuzz.common.statistics import sign_p
from vlafuzz.failures.corpus.regress import Recorded, compare
from vlafuzz.failures.corpus.sign_test import SignTest, alarm_probability, log_wealth, power_of


def outcomes(passing: int, of: int) -> list[bool]:
    return list(np.random.default_rng(0).permutation([True] * passing + [False] * (of - passing)))


def test_the_next_pair_does_not_change_the_wealth_on_average():
    worse, better = np.mgrid[0:9, 0:9]
    after = (np.exp(log_wealth(worse + 1, better)) + np.exp(log_wealth(worse, better + 1))) / 2
    assert after == pytest.approx(np.exp(log_wealth(worse, better)))


def test_the_p_value_at_the_end_is_that_of_the_exact_sign_test():
    assert sign_p(np.array([0, 5, 7]), np.array([3, 0, 1])) == pytest.approx([1, 1 / 32, 9 / 256])


@pytest.mark.parametrize("rate", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("alpha", [0.2, 0.05, 0.01])
def test_policies_of_equal_skill_raise_an_alarm_in_at_most_alpha_of_the_comparisons(rate: float, alpha: float):
    chances = binom.pmf(np.arange(61), 60, rate)
    alarms = [alarm_probability(outcomes(passing, 60), rate, alpha) for passing in range(61)]
    assert chances @ alarms <= alpha


def test_nine_of_nine_make_an_alarm_at_once_and_five_of_five_at_the_end():
    assert [SignTest(0.05, 0, better).needed for better in range(3)] == [9, 13, 17]
    assert [SignTest(0.05, 0, better, whole=True).needed for better in range(3)] == [5, 7, 9]


def test_an_alarm_is_not_taken_back():
    test = SignTest(0.05)
    p_values = []
    for worse in [True] * 9 + [False] * 9:
        test.see(worse=worse)
        p_values.append(test.p_value)
    assert test.alarm
    assert p_values == list(accumulate(p_values, min))
    assert (test.worse, test.better, test.needed) == (9, 9, 0)


@pytest.mark.parametrize(
    ("passing", "of", "said"),
    [
        (2, 40, "no alarm is possible: 2 of 40 controls pass, and it takes 5 that break"),
        (6, 40, "6 of 40 controls pass: only the loss of everything is noticed with 90% power"),
        (160, 200, "160 of 200 controls pass: a loss of 15 points or more is noticed with 90% power"),
    ],
)
def test_it_says_what_could_be_noticed(passing: int, of: int, said: str):
    assert str(power_of(outcomes(passing, of))) == said


@pytest.mark.parametrize("rate", [0.2, 0.5, 0.7])
def test_the_probability_of_an_alarm_is_that_of_the_test(rate: float):
    rng, runs = np.random.default_rng(0), 400
    recorded = [probe.passed is True for probe in probes(60)]
    alarms = [compare(probes(60), flaky(1 - rate, rng), Recorded("old")).alarm for _ in range(runs)]
    assert np.mean(alarms) == pytest.approx(alarm_probability(recorded, rate, 0.05), abs=0.07)


def test_a_loss_of_ten_points_in_200_controls_is_found_in_more_than_half():
    passing = np.arange(70, 131)
    alarms = [alarm_probability(outcomes(number, 200), 0.4, 0.05) for number in passing]
    assert binom.pmf(passing, 200, 0.5) @ alarms > 0.55


def test_the_stated_loss_is_noticed_whatever_the_baseline_was_lucky_in():
    rng, alarms = np.random.default_rng(1), []
    for _ in range(40):
        stated = power_of(recorded := list(rng.random(60) < 0.8)).loss
        alarms.append(alarm_probability(recorded, 0.8 - stated, 0.05))
    assert np.mean(alarms) > 0.85


@pytest.mark.parametrize(("passing", "chance"), [(5, 1), (4, 0)])
def test_a_policy_that_passes_nowhere_is_noticed_for_certain_where_enough_controls_pass(passing, chance):
    assert alarm_probability(outcomes(passing, 40), 0.0, 0.05) == pytest.approx(chance)
