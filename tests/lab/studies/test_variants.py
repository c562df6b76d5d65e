"""Mutants of scenes, and scenes with other instructions."""

from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import scene
from vlafuzz.errors import UsageError
from vlafuzz.lab.studies.study import COUNTS, MUTATED, Part, StudyRequest, operators_of
from vlafuzz.lab.studies.variants import MUTANTS, mutants, paraphrases, reworded, two_steps
from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings

CATALOGUE = load_catalogue()
OPERATORS = load_operators("paper-rq1")


def space(study: str) -> SearchSpace:
    return SearchSpace(OPERATORS.only(MUTATED[study]), CATALOGUE, "pick-up")


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    every = SearchSpace(OPERATORS, CATALOGUE, "pick-up")
    return [every.sample(np.random.default_rng(seed)) for seed in range(8)]


@pytest.mark.parametrize("study", ["rq3", "rq4"])
def test_a_scene_comes_as_it_is_and_in_mutants_that_differ(study: str, scenes: list[Scene]) -> None:
    made = mutants(space(study), scenes, 0, "mutant")
    assert [variant.scene for variant in made[:: 1 + MUTANTS]] == scenes
    assert [variant.arm for variant in made[:4]] == ["control", "mutant", "mutant", "mutant"]
    assert len({variant.scene for variant in made}) == len(scenes) * (1 + MUTANTS)
    for variant in made:
        assert variant.scene.placements == scenes[variant.origin].placements
        assert (variant.scene.light == Light()) or study == "rq3"
        assert (variant.scene.camera == Camera()) or study == "rq4"


def test_policies_that_passed_the_same_scene_get_the_same_mutants_of_it(scenes: list[Scene]) -> None:
    all_of_them, the_last = mutants(space("rq3"), scenes, 0, ""), mutants(space("rq3"), scenes[-1:], 0, "")
    assert [variant.scene for variant in all_of_them[-4:]] == [variant.scene for variant in the_last]
    assert all_of_them[1].scene.light != all_of_them[5].scene.light
    assert mutants(space("rq3"), scenes, 1, "")[1].scene != all_of_them[1].scene


def test_half_of_the_papers_lights_are_bright_and_most_of_these_dazzling(scenes: list[Scene]) -> None:
    made = [variant for seed in range(20) for variant in mutants(space("rq3"), scenes, seed, "mutant")]
    drawn = np.array([variant.scene.light.intensity for variant in made if variant.arm == "mutant"])
    assert np.mean(drawn > 1) == pytest.approx(0.5, abs=0.08)
    assert np.median(drawn[drawn > 1]) == pytest.approx(10.5, abs=1.5)


def test_ranges_without_room_for_three_mutants_are_refused(scenes: list[Scene]) -> None:
    light = OPERATORS.operators["light"]
    narrow = light.model_copy(update={"intensity": light.intensity.model_copy(update={"low": 1, "high": 1})})
    narrowed = replace(OPERATORS, operators={**OPERATORS.operators, "light": narrow}).only(["light"])
    with pytest.raises(UsageError, match="light: the ranges hold no 3 mutants of a scene"):
        mutants(SearchSpace(narrowed, CATALOGUE, "pick-up"), scenes, 0, "")


@pytest.mark.parametrize("task", TASKS)
def test_a_task_has_ten_paraphrases_none_of_them_the_plain_wording(task: str) -> None:
    ways = set(paraphrases(task))
    assert len(ways) == 10
    assert (load_wordings()[task][0],) not in ways
    for (way,) in ways:
        assert all(slot in way for slot in ("{a}", "{b}")[: TASKS[task].targets])


def test_tasks_of_two_steps_have_two_prompts_and_the_others_none() -> None:
    assert StudyRequest("prompts").tasks == ["move-near", "put-on", "put-in"]
    assert two_steps("put-in") == [("pick up {a} and then put {a} into {b}",), ("pick up {a}", "put {a} into {b}")]
    with pytest.raises(UsageError, match="pick-up has one step only"):
        StudyRequest("prompts", ["pick-up"])


def test_a_prompt_says_the_targets_names_and_changes_nothing_else() -> None:
    (variant,) = reworded([scene(light=2.0)], [("find {a}", "take {a}")], CATALOGUE)
    said = variant.scene
    assert (said.instruction, said.then) == ("find green cube", ("take green cube",))
    assert (said.targets, said.light) == (scene(light=2.0).targets, scene(light=2.0).light)
    assert (variant.origin, variant.arm) == (0, "find {a} / take {a}")


@pytest.mark.parametrize("count", COUNTS)
def test_the_operators_of_a_part_give_its_number_of_confounders(count: int) -> None:
    of_part = operators_of(Part("pick-up", None, confounders=count), OPERATORS)
    sampled = SearchSpace(of_part, CATALOGUE, "pick-up").sample(np.random.default_rng(1))
    assert len(sampled.confounders) == count
