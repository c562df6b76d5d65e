from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

ranges = pytest.mark.parametrize("ranges", ["tabletop", "paper", "paper-rq1"])
tasks = pytest.mark.parametrize("task", TASKS)
CATALOGUE = load_catalogue()


@cache
def sampled(ranges: str, task: str, count: int = 60) -> tuple[SearchSpace, list[Scene]]:
    space = SearchSpace(load_operators(ranges), CATALOGUE, task)
    return space, [space.sample(np.random.default_rng([1, index])) for index in range(count)]


@ranges
@tasks
def test_samples_are_fair_and_on_the_grid(ranges: str, task: str) -> None:
    space, scenes = sampled(ranges, task)
    for scene in scenes:
        bounds = space.operators.min_distance, space.operators.visible
        assert check_static(scene, CATALOGUE, *bounds) is None
        assert space.decode(space.encode(scene)) == scene


def test_every_count_and_every_object_comes_up() -> None:
    varied = ("target-type", "confounder-type", "confounder-count", "target-position", "confounder-position")
    space = SearchSpace(load_operators().only(varied), CATALOGUE, "pick-up")
    scenes = [space.sample(np.random.default_rng([2, index])) for index in range(400)]
    counts = Counter(len(scene.confounders) for scene in scenes)
    assert set(counts) == {0, 1, 2, 3}
    assert min(counts.values()) > 70
    assert {scene.targets[0].object for scene in scenes} == set(CATALOGUE.graspable())


@tasks
def test_the_same_seed_gives_the_same_scene(task: str) -> None:
    space, scenes = sampled("tabletop", task)
    again = [space.sample(np.random.default_rng([1, index])) for index in range(5)]
    assert again == scenes[:5]
    assert len({scene.digest for scene in scenes}) == len(scenes)


def test_the_papers_upright_objects_are_not_turned() -> None:
    upright = [
        placement
        for scene in sampled("paper", "pick-up")[1]
        for placement in scene.placements
        if placement.rest in ("standing", "on_edge")
    ]
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
