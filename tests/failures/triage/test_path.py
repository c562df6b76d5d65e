from dataclasses import replace

import numpy as np
import pytest

from tests.failures.triage.planted import SPACE
from vlafuzz.errors import SceneError
from vlafuzz.failures.triage.path import Path, deviating, free_genes
from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.manipulation.space import GROUPS

NOMINAL = SPACE.nominal()


def scene(**parts) -> Scene:
    return replace(NOMINAL, **parts)


def paths(genes) -> list[str]:
    return [gene.path for gene in genes]


def test_a_scene_deviates_from_a_reference_where_their_values_differ():
    reference = scene(light=Light(2.0), camera=Camera(yaw=2.0))
    failing = scene(light=Light(2.0), camera=Camera(yaw=3.0))
    assert deviating(SPACE, failing) == ["light", "camera-orientation"]
    assert deviating(SPACE, failing, reference) == ["camera-orientation"]
    assert deviating(SPACE, NOMINAL, reference) == ["light", "camera-orientation"]
    assert paths(free_genes(SPACE, failing, GROUPS["camera-orientation"], reference)) == ["camera.yaw"]


def test_a_reset_to_a_reference_takes_its_values_and_needs_its_targets():
    reference, failing = scene(light=Light(2.0)), scene(light=Light(4.0), camera=Camera(yaw=3.0))
    assert SPACE.reset(failing, ["light"], reference) == scene(light=Light(2.0), camera=Camera(yaw=3.0))
    assert SPACE.reset(failing, ["light"]) == scene(camera=Camera(yaw=3.0))
    other = replace(reference, targets=(replace(reference.targets[0], object="sponge"),))
    with pytest.raises(SceneError, match="sponge cannot stand for"):
        SPACE.reset(failing, ["light"], other)


def test_a_path_goes_from_the_reference_to_the_scene_step_by_step():
    reference, failing = scene(camera=Camera(yaw=2.0)), scene(camera=Camera(yaw=3.0, roll=-0.5))
    path = Path(SPACE, failing, free_genes(SPACE, failing, GROUPS["camera-orientation"], reference), reference)
    assert path.length == 10
    assert path.at(0) == reference
    assert path.at(4) == scene(camera=Camera(yaw=2.4, roll=-0.2))
    assert path.at(10) == failing


def test_the_direction_of_a_displacement_counts_where_both_are_displaced():
    one, other = scene(camera=Camera(0.02, 90.0, 10.0)), scene(camera=Camera(0.03, 100.0, 10.0))
    group = GROUPS["camera-position"]
    assert paths(free_genes(SPACE, other, group)) == ["camera.distance"]
    assert paths(free_genes(SPACE, other, group, one)) == ["camera.distance", "camera.azimuth"]
    assert paths(free_genes(SPACE, NOMINAL, group, one)) == ["camera.distance"]


def test_with_all_operators_reset_to_a_reference_the_reference_is_left():
    rng = np.random.default_rng(3)
    for _ in range(20):
        failing, reference = SPACE.sample(rng), SPACE.sample(rng)
        operators = [operator for group in GROUPS.values() for operator in group]
        reference = SPACE.reset(reference, ["target-type"])
        failing = SPACE.reset(failing, ["target-type"])
        assert SPACE.reset(failing, operators, reference) == reference
