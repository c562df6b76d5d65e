"""Rates of a log, by hand."""

from dataclasses import replace

import pytest

from tests.logs.samples import episodes
from vlafuzz.common.statistics import wilson
from vlafuzz.logs.episodes import rates


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


def test_conditions_have_rates():
    log = episodes(a="ssff")
    conditions = ["light", "light", "light", "dark"]
    log = [replace(one, condition=name) for one, name in zip(log, conditions, strict=True)]
    found = {rate.condition: (rate.success.count, rate.success.of) for rate in rates(log)}
    assert found == {"": (2, 4), "light": (2, 3), "dark": (0, 1)}
