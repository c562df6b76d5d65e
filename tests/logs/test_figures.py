"""Rates and recurrence of a log, by hand."""

from dataclasses import replace

import pytest

from tests.logs.samples import episodes
from vlafuzz.common.statistics import sign_test, wilson
from vlafuzz.logs.against import noticeable_loss, power
from vlafuzz.logs.episodes import Episode, rates, recurrence


def test_rates_are_of_all_and_of_each_suite_and_errors_count_for_neither():
    of_all, first, second = rates(episodes(a="sssf", b="sfe"))
    assert (of_all.suite, of_all.success.count, of_all.success.of, of_all.errors) == ("", 4, 6, 1)
    assert (first.suite, first.success.share, first.failure.share) == ("a", 0.75, 0.25)
    assert (second.success.of, second.errors) == (2, 1)
    assert (first.success.low, first.success.high) == wilson(3, 4)
    assert first.failure.low == pytest.approx(1 - first.success.high)


def test_repeats_of_an_episode_tell_less_than_as_many_episodes():
    once = episodes(a="sfsfsfsf")
    twice = [*once, *(replace(one, run="2") for one in once)]
    single, repeated = rates(once)[0].success, rates(twice)[0].success
    assert repeated.share == single.share
    assert repeated.high - repeated.low > wilson(8, 16).high - wilson(8, 16).low


def repeats(*outcomes: str) -> list[Episode]:
    return [replace(one, run=str(run)) for run, letters in enumerate(outcomes) for one in episodes(a=letters)]


def test_a_failure_that_comes_again_is_counted_in_ordered_pairs_of_repeats():
    """Episode 0 fails in two of three runs, episode 1 in one, episode 2 in none; 3 has no repeat."""
    found = recurrence(repeats("ffss", "fss", "ses"))
    assert found is not None
    assert (found.again.count, found.again.of) == (2, 5)  # 2 of 4 pairs, and 0 of 1
    assert (found.episodes, found.failing, found.mixed) == (3, 2, 2)
    assert (found.failures.count, found.failures.of) == (3, 8)


def test_without_repeats_there_is_no_recurrence():
    assert recurrence(episodes(a="fsf")) is None


def test_conditions_have_rates_and_controls_count_in_no_other():
    log = episodes(a="ssff")
    conditions = ["control", "control", "light", "dark"]
    log = [replace(one, condition=name) for one, name in zip(log, conditions, strict=True)]
    found = {rate.condition: (rate.success.count, rate.success.of) for rate in rates(log)}
    assert found == {"": (0, 2), "control": (2, 2), "light": (0, 1), "dark": (0, 1)}


@pytest.mark.parametrize(("pairs", "success"), [(60, 0.6), (200, 0.8), (500, 0.97)])
def test_the_loss_that_is_said_to_be_noticed_is_noticed_in_nine_of_ten_comparisons(pairs, success):
    import numpy as np

    loss = noticeable_loss(pairs, success, 0.05)
    assert loss is not None
    rng = np.random.default_rng(0)
    old = rng.random((400, pairs)) < success
    new = rng.random((400, pairs)) < success - loss
    counts = zip((old & ~new).sum(axis=1), (new & ~old).sum(axis=1), strict=True)
    noticed = [sign_test(int(worse), int(better)) <= 0.05 for worse, better in counts]
    assert 0.86 < np.mean(noticed) < 0.95


def test_of_very_many_pairs_the_loss_is_not_said_to_be_smaller_than_what_is_noticed():
    loss = noticeable_loss(6000, 0.9, 0.05)
    assert loss is not None
    assert 0.9 <= power(6000, 0.9, loss, 0.05) < 0.93


@pytest.mark.parametrize(("pairs", "success"), [(0, 0.9), (5, 1.0), (40, 0.05)])
def test_what_no_loss_could_show_notices_none(pairs, success):
    assert noticeable_loss(pairs, success, 0.05) is None
