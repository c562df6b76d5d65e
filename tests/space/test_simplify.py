from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.search.worlds import sampled, space
from vlafuzz.errors import SceneError
from vlafuzz.scene import Camera, Light, Scene
from vlafuzz.tasks.tabletop import TASKS

quickly = settings(max_examples=15, derandomize=True, deadline=None, database=None)
tasks = pytest.mark.parametrize("task", TASKS)
NOMINAL = space().nominal()


@tasks
@quickly
@given(seed=st.integers(0, 2**32 - 1))
def test_every_candidate_is_strictly_less_severe_and_on_the_grid(task: str, seed: int):
    one = space(task)
    scene = one.decode(np.random.default_rng(seed).random(one.dim))
    candidates = one.simpler(scene)
    assert len(set(candidates)) == len(candidates) > 0
    for candidate in candidates:
        assert one.severity(candidate) < one.severity(scene)
        assert one.decode(one.encode(candidate)) == candidate


@tasks
def test_nothing_is_simpler_than_nominal(task: str):
    assert space(task).simpler(space(task).nominal()) == []


@tasks
@quickly
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_way_is_taken_it_ends_at_nominal(task: str, seed: int):
    one, rng = space(task), np.random.default_rng(seed)
    scene = sampled(20, task)[seed % 20]
    for _ in range(400):
        candidates = one.simpler(scene)
        if not candidates:
            break
        scene = candidates[rng.integers(len(candidates))]
    assert scene == one.nominal()


def test_the_smallest_steps_end_at_nominal_too():
    one = space("pick-up", "light", "camera-position", "target-orientation")
    scene, steps = one.sample(np.random.default_rng(0)), 0
    while candidates := one.simpler(scene):
        scene, steps = candidates[-1], steps + 1
    assert scene == one.nominal()
    assert steps < 500


def test_an_operator_is_reset_a_value_halved_and_moved_by_a_step():
    grid = space().by_path["light.intensity"].grid
    levels = [grid.level(scene.light.intensity) for scene in space().simpler(lit(grid.nominal_level + 9))]
    assert levels == [grid.nominal_level, grid.nominal_level + 5, grid.nominal_level + 8]


def lit(level: int) -> Scene:
    return replace(NOMINAL, light=Light(space().by_path["light.intensity"].grid.value(level)))


def test_a_step_crosses_no_seam():
    turned = replace(NOMINAL, targets=(replace(NOMINAL.targets[0], yaw=-3.0),))
    assert [scene.targets[0].yaw for scene in space().simpler(turned)] == [0.0, -1.0, -2.0]


def test_each_confounder_can_be_left_out():
    for scene in sampled(40):
        sets = [set(each.confounders) for each in space().simpler(scene)]
        left_out = [each for each in scene.confounders if set(scene.confounders) - {each} in sets]
        assert len(left_out) >= len(scene.confounders) - 1


def test_the_direction_of_a_moved_camera_is_not_simplified():
    moved = replace(NOMINAL, camera=Camera(distance=0.004, azimuth=30.0, elevation=-20.0))
    found = [scene.camera for scene in space().simpler(moved)]
    assert found == [Camera(), *(Camera(distance, 30.0, -20.0) for distance in (0.002, 0.003))]


def test_values_off_the_grid_move_onto_it():
    found = space().simpler(replace(NOMINAL, light=Light(7.77)))
    grid = space().by_path["light.intensity"].grid
    assert found
    assert all(grid.level(scene.light.intensity) is not None for scene in found)


def test_what_no_operator_makes_is_an_error():
    strange = replace(NOMINAL, light=Light(2.0), instruction="dance")
    with pytest.raises(SceneError, match="'dance' is not a value of the operator wording"):
        space().simpler(strange)
