"""Which scenes are shown, and in which order."""

from itertools import islice
from pathlib import Path

from tests.doubles import scene
from tests.rollouts.test_scene_runner import run
from vlafuzz.exports.selection import FailingScene, around, at_random

HERE = Path("a.db")


def failure(number: int) -> FailingScene:
    """One of eight scenes that are far from each other."""
    light, x, y = (1 / 16, 16.0)[number % 2], (-0.2, 0.12)[number // 2 % 2], (-0.2, 0.2)[number // 4]
    failing = scene(light=light, x=x, y=y)
    return FailingScene(failing, run("make_frozen"))


def test_scenes_come_in_turn_first_as_they_are_then_jittered():
    failures = [failure(0), failure(4)]
    wanted = list(islice(around(HERE, failures), 6))
    assert [each.attempt for each in wanted] == [0, 0, 1, 1, 2, 2]
    assert [each.scene for each in wanted[:2]] == [each.scene for each in failures]
    assert [each.finding for each in wanted[::2]] == [failures[0].scene.digest] * 3
    assert len({each.scene for each in wanted}) == 6


def test_random_scenes_are_those_of_the_operators_and_not_those_of_the_failures():
    failures = [failure(0), failure(4)]
    wanted = list(islice(at_random(HERE, failures), 4))
    assert [each.attempt for each in wanted] == [0, 0, 1, 1]
    assert len({each.scene for each in wanted}) == 4
    assert {each.finding for each in wanted} == {""}
    again = islice(at_random(HERE, [failure(7)]), 4)
    assert [each.scene for each in again] == [each.scene for each in wanted]
