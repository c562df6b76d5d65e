"""Mutants of scenes, and what is kept of them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import failed, passed
from vlafuzz.errors import UsageError
from vlafuzz.lab.studies.mutants import MUTANTS, curve_points, kept, mutants, mutating
from vlafuzz.lab.studies.runner import Tried, Variant, pooled
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

CATALOGUE = load_catalogue()
OPERATORS = load_operators("paper-rq1")


def space(study: str, alpha: str = "linear") -> SearchSpace:
    return SearchSpace(mutating(study, OPERATORS, alpha), CATALOGUE, "pick-up")  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    every = SearchSpace(OPERATORS, CATALOGUE, "pick-up")
    return [every.sample(np.random.default_rng(seed)) for seed in range(8)]


@pytest.mark.parametrize("study", ["rq3", "rq4"])
def test_a_scene_comes_as_it_is_and_in_mutants_that_differ(study: str, scenes: list[Scene]) -> None:
    made = mutants(space(study), scenes, 0)
    assert [variant.scene for variant in made[:: 1 + MUTANTS]] == scenes
    assert len({variant.scene for variant in made}) == len(scenes) * (1 + MUTANTS)
    for variant in made:
        assert variant.scene.placements == scenes[variant.origin].placements
        assert (variant.scene.light == Light()) or study == "rq3"
        assert (variant.scene.camera == Camera()) or study == "rq4"


def test_policies_that_passed_the_same_scene_get_the_same_mutants_of_it(scenes: list[Scene]) -> None:
    all_of_them, the_last = mutants(space("rq3"), scenes, 0), mutants(space("rq3"), scenes[-1:], 0)
    assert [variant.scene for variant in all_of_them[-4:]] == [variant.scene for variant in the_last]
    assert all_of_them[1].scene.light != all_of_them[5].scene.light
    assert mutants(space("rq3"), scenes, 1)[1].scene != all_of_them[1].scene


def test_half_of_the_papers_lights_are_bright_and_most_of_these_dazzling(scenes: list[Scene]) -> None:
    def lights(alpha: str) -> np.ndarray:
        made = [variant for seed in range(20) for variant in mutants(space("rq3", alpha), scenes, seed)]
        return np.array([variant.scene.light.intensity for variant in made if variant.arm == "mutant"])

    linear, log = lights("linear"), lights("log")
    assert np.mean(linear > 1) == pytest.approx(0.5, abs=0.08)
    assert np.median(linear[linear > 1]) == pytest.approx(10.5, abs=1.5)
    assert np.median(log[log > 1]) == pytest.approx(20**0.5, abs=1)


def test_ranges_without_room_for_three_mutants_are_refused(scenes: list[Scene]) -> None:
    light = OPERATORS.operators["light"]
    narrow = light.model_copy(update={"intensity": light.intensity.model_copy(update={"low": 1, "high": 1})})
    operators = mutating("rq3", OPERATORS, "linear")
    narrowed = replace(operators, operators={**operators.operators, "light": narrow})
    only = SearchSpace(narrowed, CATALOGUE, "pick-up")
    with pytest.raises(UsageError, match="light: the ranges hold no 3 mutants of a scene"):
        mutants(only, scenes, 0)


def tried(scene: Scene, origin: int, arm: str, outcome: Outcome, light: float = 1.0) -> Tried:
    return Tried(Variant(replace(scene, light=Light(light)), origin, arm), outcome)


def test_what_broke_or_was_unfair_is_in_no_share(scenes: list[Scene]) -> None:
    (scene, *_) = scenes
    results = [
        tried(scene, 0, "control", passed()),
        tried(scene, 0, "mutant", passed(), 0.9),
        tried(scene, 0, "mutant", failed(), 0.1),
        tried(scene, 0, "mutant", Outcome.error("broke"), 0.1),
        tried(scene, 1, "control", failed()),
        tried(scene, 1, "mutant", failed(), 16.0),
        tried(scene, 1, "mutant", Outcome.invalid("geometry", "out of view"), 8.0),
    ]
    counted = kept("pick-up", "idle", results)
    assert (counted.default, counted.control.count, counted.control.of) == (2, 1, 2)
    assert (counted.mutated.count, counted.mutated.of, counted.invalid, counted.errors) == (1, 3, 1, 1)
    assert counted.mean == pytest.approx(2 / 3)
    shares = {
        (point.curve, point.low): (point.passed.count, point.passed.of) for point in curve_points("rq3", "a", results)
    }
    assert shares == {("darker", 1): (1, 1), ("darker", 8): (0, 1), ("brighter", 8): (0, 1)}
    assert [tried.variant.origin for tried in pooled([results, results])][::7] == [0, 2]
