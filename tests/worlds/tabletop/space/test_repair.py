from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.search.worlds import CATALOGUE, sampled, space
from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Camera
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.tasks import TASKS

quickly = settings(max_examples=25, derandomize=True, deadline=None, database=None)
tasks = pytest.mark.parametrize("task", TASKS)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@tasks
def test_a_fair_scene_stays_as_it_is(task: str):
    for scene in sampled(20, task):
        assert space(task).repaired(scene, rng()) == scene


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
    scenes = [one.decode(rng(seed).random(one.dim)) for seed in range(100)]
    assert sum(one.repaired(scene, rng()) is not None for scene in scenes) > 85


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
