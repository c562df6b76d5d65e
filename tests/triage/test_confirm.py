from collections.abc import Iterator

import numpy as np
import pytest

from vlafuzz.outcome import Verdict
from vlafuzz.triage.confirm import MOST, Confirmation, confirm

FAILED, PASSED, ERROR, INVALID = Verdict.FAILED, Verdict.PASSED, Verdict.ERROR, Verdict.INVALID


def repeats(*verdicts: Verdict, deterministic: bool = False) -> Confirmation:
    rest: Iterator[Verdict] = iter(verdicts)
    return confirm(lambda number: next(rest), deterministic=deterministic)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (FAILED, Confirmation(1, 1, True)),
        (PASSED, Confirmation(1, 0, False, refuted=True)),
        (ERROR, Confirmation(0, 0, False)),
        (INVALID, Confirmation(0, 0, False)),
    ],
)
def test_a_deterministic_policy_must_fail_once_more(verdict, expected):
    assert repeats(verdict, deterministic=True) == expected


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([FAILED] * 3, Confirmation(3, 3, True)),
        ([PASSED] * 3, Confirmation(3, 0, False, refuted=True)),
        ([FAILED, PASSED, FAILED, FAILED, FAILED], Confirmation(5, 4, True)),
        ([FAILED, PASSED] * (MOST // 2), Confirmation(20, 10, False)),
        ([ERROR, *[FAILED] * 3], Confirmation(3, 3, True)),
    ],
)
def test_a_stochastic_one_is_repeated_until_it_is_clear_or_often_enough(verdicts, expected):
    assert repeats(*verdicts) == expected


def test_a_crash_every_time_says_nothing_and_ends():
    assert repeats(*[ERROR] * MOST) == Confirmation(0, 0, False)


@pytest.mark.parametrize(("rate", "confirmed"), [(0.2, False), (0.8, True)])
def test_both_rates_are_taken_for_each_other_in_5_per_cent_at_most(rate, confirmed):
    rng = np.random.default_rng(0)
    found = [
        confirm(lambda number: FAILED if rng.random() < rate else PASSED, deterministic=False)
        for _ in range(2000)
    ]
    assert sum(each.confirmed is not confirmed for each in found) <= 0.05 * 2000
    assert np.mean([each.repeats for each in found]) < 7
