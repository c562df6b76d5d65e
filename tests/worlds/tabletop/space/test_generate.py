"""Random scenes, and scenes that are repaired, are fair and on the grid."""

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tests.search.worlds import CATALOGUE
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model import Camera, Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

ranges = pytest.mark.parametrize("ranges", ["tabletop", "paper", "paper-rq1"])
tasks = pytest.mark.parametrize("task", TASKS)


@cache
def drawn(ranges: str, task: str, count: int = 25) -> tuple[SearchSpace, list[Scene]]:
    space = SearchSpace(load_operators(ranges), CATALOGUE, task)
    return space, [space.sample(np.random.default_rng([1, index])) for index in range(count)]


@ranges
@tasks
def test_samples_are_fair_and_on_the_grid(ranges: str, task: str) -> None:
    space, scenes = drawn(ranges, task)
    for scene in scenes:
        bounds = space.operators.min_distance, space.operators.visible
        assert check_static(scene, CATALOGUE, *bounds) is None
        assert space.decode(space.encode(scene)) == scene


def test_every_count_and_every_object_comes_up() -> None:
    varied = ("target-type", "confounder-type", "confounder-count", "target-position", "confounder-position")
    space = SearchSpace(load_operators().only(varied), CATALOGUE, "pick-up")
    scenes = [space.sample(np.random.default_rng([2, index])) for index in range(200)]
    counts = Counter(len(scene.confounders) for scene in scenes)
    assert set(counts) == {0, 1, 2, 3}
    assert min(counts.values()) > 30
    assert {scene.targets[0].object for scene in scenes} == set(CATALOGUE.names("graspable"))


@tasks
def test_the_same_seed_gives_the_same_scene(task: str) -> None:
    space, scenes = drawn("tabletop", task)
    again = [space.sample(np.random.default_rng([1, index])) for index in range(5)]
    assert again == scenes[:5]
    assert len({scene.digest for scene in scenes}) == len(scenes)


def test_the_papers_upright_objects_are_not_turned() -> None:
    placed = [placement for scene in drawn("paper", "pick-up")[1] for placement in scene.placements]
    upright = [placement for placement in placed if placement.rest in ("standing", "on_edge")]
    assert len(upright) > 10
    assert {placement.yaw for placement in upright} == {0.0}


def test_a_box_that_is_too_small_is_an_error_with_box_count_and_distance() -> None:
    space = SearchSpace(replace(load_operators(), min_distance=0.7), CATALOGUE, "move-near")
    with pytest.raises(UsageError) as caught:
        space.sample(np.random.default_rng(0))
    for part in ("move-near", "2 target(s) and 3 confounder(s)", "0.7 m apart", "x -0.2 to 0.12 m"):
        assert part in caught.value.message
    assert "min_distance" in (caught.value.hint or "")


def test_ranges_in_which_nothing_is_seen_are_an_error_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "dark.yaml"
    night = "{low: 0.00001, high: 0.0001, step: 0.05, nominal: 0.0001}"
    path.write_text(f"extends: tabletop\noperators: {{light: {{intensity: {night}}}}}")
    with pytest.raises(UsageError, match="255 apart from the table under light") as caught:
        SearchSpace(load_operators(path), CATALOGUE, "pick-up").sample(np.random.default_rng(0))
    assert "visible" in (caught.value.hint or "")


quickly = settings(max_examples=10, derandomize=True, deadline=None, database=None)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@cache
def space(task: str = "pick-up", *vary: str) -> SearchSpace:
    operators = load_operators()
    return SearchSpace(operators.only(vary) if vary else operators, CATALOGUE, task)


@tasks
def test_a_fair_scene_stays_as_it_is(task: str):
    space, scenes = drawn("tabletop", task)
    for scene in scenes:
        assert space.repaired(scene, rng()) == scene


@tasks
@quickly
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_repaired_is_fair_and_on_the_grid(task: str, seed: int):
    one = space(task)
    scene = one.decode(rng(seed).random(one.dim))
    repaired = one.repaired(scene, rng(seed))
    if repaired is not None:
        assert check_static(repaired, CATALOGUE, one.operators.min_distance) is None
        assert one.decode(one.encode(repaired)) == repaired


@tasks
def test_most_scenes_can_be_repaired(task: str):
    one = space(task)
    scenes = [one.decode(rng(seed).random(one.dim)) for seed in range(40)]
    assert sum(one.repaired(scene, rng()) is not None for scene in scenes) > 32


def test_only_what_has_no_room_moves_and_not_farther_than_it_takes():
    one, away = space(), []
    for seed in range(60):
        scene = one.decode(rng(seed).random(one.dim))
        repaired = one.repaired(scene, rng(seed))
        if repaired is None:
            continue
        assert (repaired.light, repaired.camera) == (scene.light, scene.camera)
        pairs = zip(scene.placements, repaired.placements, strict=True)
        away += [np.hypot(a.x - b.x, a.y - b.y) for a, b in pairs]
    moved = [distance for distance in away if distance > 0]
    assert 0.1 < len(moved) / len(away) < 0.5
    assert np.median(moved) < 0.12


def test_where_positions_do_not_vary_nothing_is_moved():
    one = space("pick-up", "confounder-count", "confounder-type")
    crowd = one.decode(np.array([0.0, 0.5, 0.9, 0.99]))
    assert len(crowd.confounders) == 3
    repaired = one.repaired(crowd, rng())
    assert repaired is None or [(e.x, e.y) for e in repaired.placements] == [(e.x, e.y) for e in crowd.placements]


@pytest.mark.parametrize("far", [9.0, -50.0, 1e6])
def test_a_scene_far_outside_all_ranges_is_repaired_at_their_ends(far: float):
    one = space("pick-up")
    (target,) = one.nominal().targets
    scene = replace(one.nominal(), targets=(replace(target, x=far, yaw=far),), camera=Camera(roll=far))
    repaired = one.repaired(scene, rng())
    assert repaired is not None
    assert one.decode(one.encode(repaired)) == repaired


def test_a_scene_with_something_unknown_is_refused_not_repaired():
    one = space("pick-up")
    with pytest.raises(SceneError, match="'sing' is not a value of the operator wording"):
        one.repaired(replace(one.nominal(), instruction="sing"), rng())
