"""Which failures are shown, and which are held out: causes stay together."""

from itertools import islice
from pathlib import Path

import pytest

from tests.doubles import scene
from tests.rollouts.test_scene_runner import run
from vlafuzz.errors import UsageError
from vlafuzz.exports.selection import FailingScene, around, at_random, split

HERE = Path("a.db")


def failure(number: int, cause: str) -> FailingScene:
    """One of eight scenes that are far from each other."""
    light, x, y = (1 / 16, 16.0)[number % 2], (-0.2, 0.12)[number // 2 % 2], (-0.2, 0.2)[number // 4]
    failing = scene(light=light, x=x, y=y)
    return FailingScene(failing, run("make_frozen"), cause)


def test_failures_of_one_cause_are_on_one_side():
    failures = [failure(n, f"cause {n % 4}") for n in range(8)]
    shown, held_out = split(HERE, failures, 0.25)
    assert (len(shown), len(held_out)) == (6, 2)
    assert not {each.cause for each in shown} & {each.cause for each in held_out}


def test_nothing_is_lost_and_the_split_is_the_same_again():
    failures = [failure(n, f"cause {n}") for n in range(6)]
    shown, held_out = split(HERE, failures, 0.5)
    assert {each.scene for each in shown + held_out} == {each.scene for each in failures}
    assert len(shown) == len(held_out) == 3
    assert split(HERE, failures, 0.5) == (shown, held_out)


def test_the_only_cause_cannot_be_held_out():
    failures = [failure(n, "the same") for n in range(6)]
    with pytest.raises(UsageError, match="6 failures have one cause"):
        split(HERE, failures, 0.2)
    assert split(HERE, failures, 0.0) == (failures, [])


def test_of_two_large_causes_the_smaller_one_is_held_out():
    failures = [failure(n, "common" if n < 4 else "rare") for n in range(6)]
    assert len(split(HERE, failures, 0.05)[1]) == 2


def test_scenes_come_in_turn_first_as_they_are_then_jittered():
    failures = [failure(0, "a"), failure(4, "b")]
    wanted = list(islice(around(HERE, failures), 6))
    assert [each.attempt for each in wanted] == [0, 0, 1, 1, 2, 2]
    assert [each.scene for each in wanted[:2]] == [each.scene for each in failures]
    assert [each.finding for each in wanted[::2]] == [failures[0].scene.digest] * 3
    assert len({each.scene for each in wanted}) == 6


def test_random_scenes_are_those_of_the_operators_and_not_those_of_the_failures():
    failures = [failure(0, "a"), failure(4, "b")]
    wanted = list(islice(at_random(HERE, failures), 4))
    assert [each.attempt for each in wanted] == [0, 0, 1, 1]
    assert len({each.scene for each in wanted}) == 4
    assert {each.finding for each in wanted} == {""}
    again = islice(at_random(HERE, [failure(7, "c")]), 4)
    assert [each.scene for each in again] == [each.scene for each in wanted]
