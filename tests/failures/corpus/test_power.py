"""The loss that a comparison can notice, as it is said before anything is run."""

import numpy as np
import pytest

from tests.failures.corpus.sides import flaky, probes
from vlafuzz.failures.corpus.power import alarm_probability, power_of
from vlafuzz.failures.corpus.regress import Recorded, compare

FIFTH_FAILS = [probe.passed is True for probe in probes(60)]


def outcomes(passing: int, of: int) -> list[bool]:
    return list(np.random.default_rng(0).permutation([True] * passing + [False] * (of - passing)))


@pytest.mark.parametrize(
    ("passing", "of", "said"),
    [
        (2, 40, "no alarm is possible: 2 of 40 controls pass, and it takes 8 that break"),
        (10, 40, "10 of 40 controls pass: only the loss of everything is noticed with 90% power"),
        (160, 200, "160 of 200 controls pass: a loss of 17 points or more is noticed with 90% power"),
    ],
)
def test_it_says_what_could_be_noticed(passing: int, of: int, said: str):
    assert str(power_of(outcomes(passing, of))) == said


@pytest.mark.parametrize("rate", [0.2, 0.5, 0.7])
def test_the_probability_of_an_alarm_is_that_of_the_test(rate: float):
    rng, runs = np.random.default_rng(0), 400
    alarms = [compare(probes(60), flaky(1 - rate, rng), Recorded("old")).alarm for _ in range(runs)]
    assert np.mean(alarms) == pytest.approx(alarm_probability(FIFTH_FAILS, rate, 0.05), abs=0.07)


def test_the_stated_loss_is_noticed_whatever_the_baseline_was_lucky_in():
    rng, alarms = np.random.default_rng(1), []
    for _ in range(40):
        stated = power_of(recorded := list(rng.random(60) < 0.8)).loss
        alarms.append(alarm_probability(recorded, 0.8 - stated, 0.05))
    assert np.mean(alarms) > 0.85


def test_a_policy_that_passes_nowhere_is_noticed_for_certain_where_eight_controls_pass():
    assert alarm_probability(outcomes(8, 40), 0.0, 0.05) == pytest.approx(1)
    assert alarm_probability(outcomes(7, 40), 0.0, 0.05) == 0
