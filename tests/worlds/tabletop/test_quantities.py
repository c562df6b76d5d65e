"""How a target looks in the first picture, and what is near it."""

import math
from dataclasses import replace

import pytest

from tests.failures.triage.planted import CATALOGUE
from vlafuzz.model import Camera, Light, Placement
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

SPACE = SearchSpace(load_operators(), CATALOGUE, "pick-up")
NOMINAL = SPACE.nominal()
USUAL = SPACE.measured(NOMINAL)


def with_camera(**values: float):
    return SPACE.measured(replace(NOMINAL, camera=Camera(**values)))


def test_nominally_the_target_appears_where_it_usually_does():
    assert (USUAL["right"], USUAL["down"], USUAL["hidden"], USUAL["nearest"]) == (0, 0, 0, math.inf)


@pytest.mark.parametrize(
    ("camera", "quantity", "sign"),
    [({"pitch": 3.0}, "down", -1), ({"yaw": 3.0}, "right", 1), ({"distance": 0.05, "elevation": 90.0}, "down", 1)],
    ids=["tilted down", "turned left", "raised"],
)
def test_a_camera_that_moves_shifts_the_target(camera: dict[str, float], quantity: str, sign: int):
    values = with_camera(**camera)
    assert sign * values[quantity] > 5
    assert {name: values[name] for name in ("reach", "nearest")} == {"reach": USUAL["reach"], "nearest": math.inf}


def test_a_tilted_camera_makes_the_target_seem_nearer_or_farther_and_a_turned_one_beside():
    for pitch in (-3.0, 3.0):
        tilted = with_camera(pitch=pitch)
        assert tilted["depth"] == pytest.approx(tilted["aside"], abs=0.5)
        assert 3 < tilted["depth"] < 9
    turned = with_camera(yaw=3.0)
    assert 3 * turned["depth"] < turned["aside"] < 9


def test_with_the_usual_camera_a_target_seems_to_be_where_it_is_wherever_that_is():
    values = SPACE.measured(replace(NOMINAL, targets=(replace(NOMINAL.targets[0], x=0.05, y=-0.1),)))
    assert values["down"] > 5
    assert (values["aside"], values["depth"]) == pytest.approx((0, 0), abs=1e-9)


def test_in_the_dark_the_target_is_darker_and_less_apart_from_the_table():
    dark = SPACE.measured(replace(NOMINAL, light=Light(0.1)))
    assert dark["brightness"] < USUAL["brightness"] / 2
    assert dark["contrast"] < USUAL["contrast"] / 2


def test_a_thing_before_the_target_hides_some_of_it_and_is_near():
    target = NOMINAL.targets[0]
    bottle = Placement("blue_plastic_bottle", "standing", target.x + 0.1, target.y)
    values = SPACE.measured(replace(NOMINAL, confounders=(bottle,)))
    assert values["hidden"] > 10
    assert values["nearest"] == pytest.approx(0.1)


def test_a_target_farther_from_the_camera_appears_smaller():
    target = replace(NOMINAL.targets[0], x=-0.2)
    values = SPACE.measured(replace(NOMINAL, targets=(target,)))
    assert values["size"] < USUAL["size"] - 1
    assert values["reach"] == pytest.approx(USUAL["reach"] - 0.15, abs=0.01)


def test_a_second_target_has_quantities_of_its_own():
    space = SearchSpace(load_operators(), CATALOGUE, "put-on")
    values = space.measured(space.nominal())
    assert values.keys() == space.quantities.keys()
    assert values["down-2"] == 0
    assert space.quantities["down-2"].says(4, above=False) == "the second target appears ≥ 4 px higher than usual"


@pytest.mark.parametrize(
    ("name", "threshold", "above", "says"),
    [
        ("down", 11, True, "the target appears ≥ 11 px lower than usual"),
        ("down", -11, False, "the target appears ≥ 11 px higher than usual"),
        ("right", -7, False, "the target appears ≥ 7 px farther left than usual"),
        ("size", 20, False, "the target appears ≤ 20 px large"),
        ("nearest", 0.21, False, "a confounder is ≤ 0.21 m from the target"),
        ("hidden", 35, True, "≥ 35% of the target is hidden"),
    ],
)
def test_a_threshold_is_said_in_words(name: str, threshold: float, above: bool, says: str):
    assert SPACE.quantities[name].says(threshold, above=above) == says
