from dataclasses import replace

import pytest

from vlafuzz.model import Light, Placement, Rejection, Scene
from vlafuzz.worlds.tabletop.fairness import check_semantic
from vlafuzz.worlds.tabletop.fairness.checks import ambiguous
from vlafuzz.worlds.tabletop.objects import load_catalogue

CATALOGUE = load_catalogue()


def at(name: str, rest: str | None = None, scale: float = 1.0) -> Placement:
    return Placement(name, rest or CATALOGUE[name].stable_poses[0].name, 0.0, 0.0, scale=scale)


def scene(task: str, *targets: Placement, confounders: tuple[Placement, ...] = ()) -> Scene:
    return Scene(task, targets, "do it", confounders=confounders)


FAIR = {
    "pick up": scene("pick-up", at("coke_can")),
    "confounders": scene("pick-up", at("coke_can"), confounders=(at("spoon"), at("pepsi_can", "lying"))),
    "near": scene("move-near", at("apple"), at("coke_can")),
    "can on plate": scene("put-on", at("coke_can"), at("plate")),
    "a lying can on a dished plate": scene("put-on", at("coke_can", "lying"), at("large_plate")),
    "a bottle hangs over": scene("put-on", at("blue_plastic_bottle"), at("short_table_cloth")),
    "a lying can in the basket": scene("put-in", at("redbull_can", "lying"), at("basket")),
    "raw orientation": scene("pick-up", replace(at("coke_can", "?"), quaternion=(1.0, 0.0, 0.0, 0.0))),
}


@pytest.mark.parametrize("fair", FAIR.values(), ids=FAIR)
def test_fair(fair: Scene) -> None:
    assert check_semantic(fair, CATALOGUE) is None


TURNED = replace(at("apple"), quaternion=(1.0, 1.0, 0.0, 0.0))
LARGE = replace(at("spoon", scale=4.0), rest="", quaternion=(1.0, 0.0, 0.0, 0.0))
PLATES, SAUCER = (at("apple"), at("plate")), at("plate", scale=0.2)
BOTTLE, BASKET = at("blue_plastic_bottle", "lying"), at("basket")
UNFAIR = {
    "unknown task 'dance'": scene("dance", at("apple")),
    "unknown robot 'r2'": replace(scene("pick-up", at("apple")), robot="r2"),
    "an instruction is empty": replace(scene("pick-up", at("apple")), instruction=" "),
    "light: an intensity of -1 is negative": replace(scene("pick-up", at("apple")), light=Light(-1.0)),
    "move-near names 2 target(s), the scene has 1": scene("move-near", at("apple")),
    "unknown object 'duck'": scene("pick-up", Placement("duck", "flat", 0, 0)),
    "apple: unknown rest pose 'lying', it has resting": scene("pick-up", at("apple", "lying")),
    "apple: a scale of 0 is not positive": scene("pick-up", at("apple", scale=0.0)),
    "apple: the quaternion (1.0, 1.0, 0.0, 0.0) is not of length 1": scene("pick-up", TURNED),
    "'apple' and 'apple' cannot be told apart by name": scene("pick-up", at("apple"), confounders=(at("apple"),)),
    "'plate' and 'large plate' cannot be told apart by name": scene(
        "put-on", *PLATES, confounders=(at("large_plate"),)
    ),
    "plate is not graspable": scene("pick-up", at("plate")),
    "sponge, flat, is 0.140 m wide: the gripper takes up to 0.074 m": scene("pick-up", at("sponge", scale=2.0)),
    "nothing can be put on apple": scene("put-on", at("spoon"), at("apple")),
    "nothing can be put on basket": scene("put-on", at("spoon"), at("basket")),
    "nothing can be put into plate": scene("put-in", at("spoon"), at("plate")),
    "orange, resting, rolls off table cloth": scene("put-on", at("orange"), at("table_cloth")),
    "coke can, lying, rolls off table cloth": scene("put-on", at("coke_can", "lying"), at("table_cloth")),
    "sponge, 0.122 x 0.070 m, is too large for plate, 0.032 m across": scene("put-on", at("sponge"), SAUCER),
    "blue plastic bottle, lying, does not fit into basket, 0.17 x 0.136 m inside": scene("put-in", BOTTLE, BASKET),
    "spoon does not fit into basket, 0.17 x 0.136 m inside": scene("put-in", LARGE, BASKET),
}


@pytest.mark.parametrize(("reason", "unfair"), UNFAIR.items(), ids=UNFAIR)
def test_unfair(reason: str, unfair: Scene) -> None:
    assert check_semantic(unfair, CATALOGUE) == Rejection("semantic", reason)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ("plate", "large plate", True),
        ("Apple", "apple", True),
        ("coke can", "pepsi can", False),
        ("apple", "pineapple", False),
        ("table cloth", "short table cloth", True),
    ],
)
def test_a_name_that_has_all_words_of_another_is_ambiguous(a: str, b: str, expected: bool) -> None:
    assert ambiguous(a, b) == ambiguous(b, a) == expected
