"""Rates of a log, and two logs compared, by hand."""

from dataclasses import replace

import pytest

from tests.logs.samples import episodes
from vlafuzz.common.statistics import wilson
from vlafuzz.logs.against import compare
from vlafuzz.logs.episodes import LoggedEpisode, rates

NAMES = ("old", "new")


def test_rates_are_of_all_and_of_each_suite_and_errors_count_for_neither():
    of_all, first, second = rates(episodes(a="sssf", b="sfe"))
    assert (of_all.suite, of_all.success.count, of_all.success.of, of_all.errors) == ("", 4, 6, 1)
    assert (first.suite, first.success.share) == ("a", 0.75)
    assert (second.success.of, second.errors) == (2, 1)
    assert (first.success.low, first.success.high) == wilson(3, 4)


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


def test_the_same_episodes_are_compared_in_pairs():
    """Seven are lost and one is won: the sign test's p is 2 * (1 + 8) / 2**8."""
    result = compare(episodes(a="ssssssssf"), episodes(a="sfffffffs"), NAMES, 0.05)
    (contrast,) = result.contrasts
    assert (contrast.paired, contrast.worse, contrast.better, contrast.left) == (True, 7, 1, 0)
    assert contrast.p == pytest.approx(18 / 256)
    assert result.verdict == "new is not shown to differ from old"
    assert result.tells


def test_an_episode_without_a_judged_partner_is_left_out():
    (contrast,) = compare(episodes(a="ssse"), episodes(a="fffff"), NAMES, 0.05).contrasts
    assert (contrast.new.of, contrast.worse, contrast.left) == (3, 3, 2)


def test_repeats_of_an_episode_are_paired_once_each_and_count_as_one():
    old = [replace(one, run=run) for run in "12" for one in episodes(a="ssss")]
    new = [replace(one, run=run) for run in "12" for one in episodes(a="fsff" if run == "1" else "fsfs")]
    (contrast,) = compare(old, new, NAMES, 0.05).contrasts
    assert (contrast.new.of, contrast.worse, contrast.better) == (8, 3, 0)
    (once,) = compare(old, episodes(a="fsff"), NAMES, 0.05).contrasts
    assert (once.new.of, once.worse, once.left) == (4, 3, 4)


def test_other_episodes_are_compared_as_two_samples():
    """Of 8 and 8, 8 and 2 succeed: Fisher's p is twice C(8, 2) / C(16, 6)."""
    new = [replace(one, state=f"other {one.state}") for one in episodes(a="ssffffff")]
    (contrast,) = compare(episodes(a="ssssssss"), new, NAMES, 0.05).contrasts
    assert not contrast.paired
    assert contrast.p == pytest.approx(2 * 28 / 8008)
    assert contrast.fell


def test_suites_are_corrected_for_their_number_and_the_loss_of_one_is_named():
    """Eight of eight lost: 2 / 2**8 times three tests, two suites and both together."""
    result = compare(episodes(a="s" * 8, b="s" * 8), episodes(a="f" * 8, b="s" * 8), NAMES, 0.05)
    assert [one.suite for one in result.contrasts] == ["a", "b", "all"]
    assert result.contrasts[0].p_holm == pytest.approx(3 * 2 / 256)
    assert result.worse == ["a", "all"]
    assert result.verdict == "new is worse than old in a, all, not shown to differ in b"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (episodes(a="fffffff"), episodes(a="fffffff"), "too few episodes succeed in old"),
        (episodes(a="sssss"), episodes(a="fffff"), "too few episodes succeed in old"),
        (episodes(a="s" * 9), episodes(b="f" * 9), "no suite in common"),
        (episodes(a="s" * 19), episodes(a="s" * 9 + "e" * 10), "ended in an error"),
    ],
)
def test_logs_that_could_show_no_loss_tell_nothing(old: list[LoggedEpisode], new: list[LoggedEpisode], why: str):
    result = compare(old, new, NAMES, 0.05)
    assert not result.tells
    assert result.verdict.startswith("cannot tell: ")
    assert why in result.verdict
