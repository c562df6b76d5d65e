"""What the strategy `causes` makes of an earlier run: hints that it tests."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.search.test_causes import dark, operators, played, turned_left_and_far
from tests.search.worlds import sampled, space
from vlafuzz.model.scene import Light, Scene
from vlafuzz.search.causes.predecessor import KINDS, Forecast, Predecessor
from vlafuzz.search.causes.units import Units

NOMINAL = space().nominal()
FAR_LEFT = replace(NOMINAL, camera=replace(NOMINAL.camera, yaw=4.0, distance=0.04))
DARKENED = replace(NOMINAL, light=replace(NOMINAL.light, intensity=0.06))


def earlier(fails: Callable[[Scene], bool], *causes: tuple[Scene, tuple[str, ...]]) -> Predecessor:
    """A run of 300 random scenes."""
    scenes = sampled(300)
    return Predecessor(
        tuple((space().nearest(scene), names) for scene, names in causes),
        np.array([space().nearest(scene) for scene in scenes]),
        np.array([fails(scene) for scene in scenes]),
    )


LEFT = FAR_LEFT, ("camera-position", "camera-orientation")


def test_a_cause_that_is_left_is_found_anew_within_eighty_rollouts():
    like = earlier(turned_left_and_far, LEFT)
    assert operators(played(turned_left_and_far, 80, like=like)) == {("camera-position", "camera-orientation")}
    assert not operators(played(turned_left_and_far, 80))


def test_a_cause_that_is_mended_is_not_listed_and_explains_no_failure():
    strategy = played(dark, 150, like=earlier(turned_left_and_far, LEFT))
    assert operators(strategy) == {("light",)}
    assert all(dark(space().decode(genome)) for genome in strategy.unexplained)


def test_of_a_cause_only_the_operators_that_matter_are_listed():
    both = replace(DARKENED, camera=FAR_LEFT.camera), ("light", "camera-position", "camera-orientation")
    assert operators(played(dark, 60, like=earlier(dark, both))) == {("light",)}


def test_a_predecessor_that_shares_nothing_leaves_the_list_as_it_would_be():
    like = earlier(lambda scene: scene.targets[0].x > 0, (replace(NOMINAL, light=Light(intensity=4.0)), ("light",)))
    assert operators(played(dark, 150, like=like)) == {("light",)}


def test_outcomes_of_a_predecessor_make_the_interval_of_the_failure_probability_narrower():
    widths = []
    for like in (None, earlier(lambda scene: scene.targets[0].x > 0)):
        found = played(lambda scene: scene.targets[0].x > 0, 150, like=like).probability()
        assert found.low <= np.mean([scene.targets[0].x > 0 for scene in sampled(300)]) <= found.high
        widths.append(found.high - found.low)
    assert widths[1] < 0.9 * widths[0]


@pytest.mark.parametrize("fails", [lambda scene: False, lambda scene: True], ids=["never", "always"])
def test_a_predecessor_that_failed_never_or_always_tells_scenes_apart_by_nothing(fails: Callable[[Scene], bool]):
    units = Units(space().genes, np.array([gene.grid.nominal_level for gene in space().genes]))
    like = earlier(fails)
    assert len(set(Forecast(like, units).kinds(np.array([units.levels(one) for one in like.genomes])))) == 1


def test_a_forecast_sorts_scenes_by_how_likely_they_fail():
    units = Units(space().genes, np.array([gene.grid.nominal_level for gene in space().genes]))
    forecast = Forecast(earlier(dark), units)
    levels = np.array([units.levels(space().nearest(scene)) for scene in (DARKENED, NOMINAL)])
    assert forecast.kinds(levels).tolist() == [KINDS - 1, 0]
