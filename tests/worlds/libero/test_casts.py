"""Which things LIBERO's scenes may have, and how they are said: data alone, without LIBERO."""

from dataclasses import replace
from pathlib import Path

import pytest

from vlafuzz.errors import SceneError
from vlafuzz.model import Placement, Scene
from vlafuzz.worlds.libero.casts import cast, extras, kind_of, load_objects, mistakable, recast, swaps
from vlafuzz.worlds.libero.suites import REST, LiberoTask

BOWL = LiberoTask(
    suite="libero_goal",
    number=8,
    instruction="put the bowl on the plate",
    bddl=Path("bowl.bddl"),
    initial=(("on", "akita_black_bowl_1", "main_table_bowl_region"),),
    goal=(("on", "akita_black_bowl_1", "plate_1"),),
    interest=("akita_black_bowl_1", "plate_1"),
    things=("akita_black_bowl_1", "plate_1", "wine_bottle_1"),
)
BASKET = replace(
    BOWL,
    instruction="put both the cream cheese box and the butter in the basket",
    goal=(("in", "cream_cheese_1", "basket_1_contain_region"), ("in", "butter_1", "basket_1_contain_region")),
    initial=(),
    interest=("cream_cheese_1", "butter_1", "basket_1"),
    things=("cream_cheese_1", "butter_1", "basket_1", "milk_1"),
)


def scene(*things: str, added: tuple[str, ...] = ()) -> Scene:
    targets, confounders = (tuple(Placement(name, REST, 0.0, 0.0) for name in names) for names in (things, added))
    return Scene("libero_goal/8", targets, "put the bowl on the plate", confounders=confounders)


def test_what_is_carried_may_be_another_thing_of_its_class_and_the_rest_not():
    bowls = ("akita_black_bowl_1", "red_akita_black_bowl", "yellow_bowl")
    assert swaps(BOWL) == (bowls, ("plate_1",), ("wine_bottle_1",))


def test_what_is_there_already_or_not_said_once_is_not_swapped():
    assert "milk" in load_objects().alike("butter")
    assert not {"milk", "butter"} & set(swaps(BASKET)[0])
    assert swaps(replace(BOWL, instruction="put both bowls on the plate"))[0] == ("akita_black_bowl_1",)


def test_a_swapped_task_is_about_the_new_thing_in_its_instruction_start_and_goal():
    task = recast(BOWL, ("yellow_bowl", "plate_1", "wine_bottle_1"))
    assert task.instruction == "put the yellow bowl on the plate"
    assert task.goal == (("on", "yellow_bowl", "plate_1"),)
    assert task.initial == (("on", "yellow_bowl", "main_table_bowl_region"),)
    assert task.carried == ("yellow_bowl",)
    assert task.concerned == 2


def test_two_things_are_swapped_apart_and_the_longest_words_are_replaced():
    task = recast(BASKET, ("popcorn", "ketchup", "basket_1", "milk_1"))
    assert task.instruction == "put both the popcorn and the ketchup in the basket"
    with pytest.raises(SceneError, match="one thing is there twice"):
        recast(BASKET, ("popcorn", "popcorn", "basket_1", "milk_1"))


def test_nothing_is_added_that_is_there_or_could_be_taken_for_what_is_said():
    """A white bowl could be the bowl, and a bottle of wine stands there already."""
    assert set(extras(BOWL)) == {"popcorn", "ketchup", "macaroni_and_cheese", "milk", "red_coffee_mug"}
    assert mistakable("white_bowl", "put the bowl on the plate")
    assert not mistakable("white_bowl", "put the black bowl on the plate")


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (scene("apple", "plate_1", "wine_bottle_1"), "targets: apple, .* are not the things of libero_goal/8"),
        (scene("akita_black_bowl_1", "plate_1"), "targets: akita_black_bowl_1, plate_1 are not the things"),
        (scene("akita_black_bowl_1", "yellow_plate", "wine_bottle_1"), "are not the things of"),
        (scene(*BOWL.things, added=("apple",)), "'apple' cannot be added to libero_goal/8"),
        (scene(*BOWL.things, added=("white_bowl",)), "'white_bowl' cannot be added"),
        (scene(*BOWL.things, added=("milk", "milk")), "milk is there twice"),
    ],
)
def test_what_a_task_cannot_have_is_refused_in_a_sentence(given: Scene, problem: str):
    with pytest.raises(SceneError, match=problem):
        cast(BOWL, given)


def test_a_things_number_is_no_part_of_its_kind():
    assert kind_of("chefmate_8_frypan_1") == "chefmate_8_frypan"
    assert kind_of("white_bowl") == "white_bowl"
