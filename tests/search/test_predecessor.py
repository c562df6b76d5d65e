"""What the strategy `causes` makes of an earlier run: hints that it tests."""

from dataclasses import replace

from tests.search.test_causes import dark, operators, played, turned_left_and_far
from tests.search.worlds import space
from vlafuzz.model.scene import Scene
from vlafuzz.search.base import Cause

NOMINAL = space().nominal()
FAR_LEFT = replace(NOMINAL, camera=replace(NOMINAL.camera, yaw=4.0, distance=0.04))
DARKENED = replace(NOMINAL, light=replace(NOMINAL.light, intensity=0.06))


def earlier(scene: Scene, *operators: str) -> list[Cause]:
    return [Cause(space().nearest(scene), operators, 1)]


LEFT = earlier(FAR_LEFT, "camera-position", "camera-orientation")


def test_a_cause_that_is_left_is_found_anew_within_eighty_rollouts():
    found = operators(played(turned_left_and_far, 80, like=LEFT))
    assert found == {("camera-position", "camera-orientation")}
    assert not operators(played(turned_left_and_far, 80))


def test_a_cause_that_is_mended_is_not_listed_and_explains_no_failure():
    strategy = played(dark, 150, like=LEFT)
    assert operators(strategy) == {("light",)}
    assert all(dark(space().decode(genome)) for genome in strategy.unexplained)


def test_of_a_cause_only_the_operators_that_matter_are_listed():
    both = replace(DARKENED, camera=FAR_LEFT.camera)
    like = earlier(both, "light", "camera-position", "camera-orientation")
    assert operators(played(dark, 60, like=like)) == {("light",)}
