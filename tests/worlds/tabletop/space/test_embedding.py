from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.search.worlds import sampled, space
from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.tabletop.tasks import TASKS

quickly = settings(max_examples=50, derandomize=True, deadline=None, database=None)
tasks = pytest.mark.parametrize("task", TASKS)


def apart(one: Scene, other: Scene) -> float:
    vectors = [space(one.task).embed(scene) for scene in (one, other)]
    return float(np.linalg.norm(vectors[0] - vectors[1]))


def turned(yaw: float) -> Scene:
    scene = space().nominal()
    return replace(scene, targets=(replace(scene.targets[0], yaw=yaw),))


@tasks
def test_vectors_are_finite_and_of_one_length(task: str):
    vectors = [space(task).embed(scene) for scene in (*sampled(30, task), space(task).nominal())]
    assert len({vector.shape for vector in vectors}) == 1
    assert np.isfinite(vectors).all()


@tasks
@quickly
@given(seed=st.integers(0, 2**32 - 1))
def test_equal_scenes_are_no_distance_apart_and_an_operator_makes_at_most_one(task: str, seed: int):
    one, rng = space(task), np.random.default_rng(seed)
    genome = rng.random(one.dim)
    scene = one.decode(genome)
    assert apart(scene, one.decode(one.encode(scene))) == 0.0
    for name in ("target-position", "target-orientation", "light", "camera-position", "camera-orientation"):
        changed = genome.copy()
        own = [index for index, gene in enumerate(one.genes) if gene.operator == name]
        changed[own] = rng.random(len(own))
        assert apart(scene, one.decode(changed)) <= 1 + 1e-9


def test_the_ends_of_a_range_are_one_apart():
    dark, bright = (replace(space().nominal(), light=Light(intensity)) for intensity in (0.05, 20.0))
    assert apart(dark, bright) == pytest.approx(1.0)


def test_angles_have_no_seam():
    assert apart(turned(179.0), turned(-179.0)) < apart(turned(0.0), turned(5.0))
    half = np.sqrt(0.5)  # of the operator, which has yaw and rest
    assert apart(turned(0.0), turned(180.0)) == pytest.approx(half)


def test_a_camera_that_is_hardly_moved_is_near_whatever_its_direction():
    nominal = space().nominal()
    near, far = (
        [replace(nominal, camera=Camera(distance, azimuth)) for azimuth in (1.0, -179.0)] for distance in (0.001, 0.05)
    )
    assert apart(*near) == pytest.approx(0.02)
    assert apart(*far) == pytest.approx(1.0)


def test_any_two_types_are_as_far_apart_as_any_others():
    target, names = space().nominal().targets[0], ("pepsi_can", "coke_can", "redbull_can")
    scenes = [replace(space().nominal(), targets=(replace(target, object=name),)) for name in names]
    assert [round(apart(a, b), 9) for a, b in combinations(scenes, 2)] == [1.0, 1.0, 1.0]


def test_one_confounder_more_makes_a_difference_for_every_operator_of_confounders():
    crowded = next(scene for scene in sampled(50) if len(scene.confounders) == 3)
    fewer = replace(crowded, confounders=crowded.confounders[:2])
    fewest = replace(crowded, confounders=crowded.confounders[:1])
    assert 0.3 < apart(crowded, fewer) < apart(crowded, fewest)


def test_strange_values_are_numbers_too():
    changes = {"light": Light(1000.0), "instruction": "dance", "confounders": sampled(1)[0].targets}
    strange = replace(space().nominal(), **changes)
    quaternion = replace(strange.targets[0], quaternion=(1.0, 0.0, 0.0, 0.0), object="duck")
    assert np.isfinite(space().embed(replace(strange, targets=(quaternion,)))).all()
