"""Scenes as genomes and as vectors: there and back, how far from nominal, how far apart."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tests.search.worlds import sampled, space
from vlafuzz.errors import SceneError
from vlafuzz.model import Camera, Light, Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.space import SearchSpace
from vlafuzz.worlds.tabletop.tasks import TASKS

quickly = settings(max_examples=10, derandomize=True, deadline=None, database=None)
tasks = pytest.mark.parametrize("task", TASKS)
seeds = st.integers(0, 2**32 - 1)


def scenes(task: str, count: int = 20) -> list[Scene]:
    return [space(task).sample(np.random.default_rng([0, index])) for index in range(count)]


@tasks
@quickly
@given(seed=seeds)
def test_the_nearest_genome_of_a_scene_of_the_space_is_its_own(task: str, seed: int) -> None:
    one = space(task)
    scene = one.decode(np.random.default_rng(seed).random(one.dim))
    assert np.array_equal(one.nearest(scene), one.encode(scene))


@tasks
@quickly
@given(seed=seeds)
def test_of_a_scene_from_elsewhere_the_nearest_genome_is_half_a_step_off_at_most(task: str, seed: int) -> None:
    one, rng = space(task), np.random.default_rng(seed)
    scene = one.sample(rng)
    step = one.by_path["targets.0.x"].grid.step
    first, *others = scene.targets
    low, high = one.by_path["targets.0.x"].grid.low, one.by_path["targets.0.x"].grid.high
    moved = replace(first, x=float(np.clip(first.x + rng.uniform(-0.3, 0.3) * step, low, high)))
    near = one.decode(one.nearest(replace(scene, targets=(moved, *others))))
    assert near == scene


@tasks
@quickly
@given(seed=seeds)
def test_genes_that_a_scene_does_not_use_mean_nothing(task: str, seed: int) -> None:
    one = space(task)
    scene = one.sample(np.random.default_rng(seed))
    genome = one.encode(scene)
    beyond = tuple(f"confounders.{slot}." for slot in range(len(scene.confounders), 10))
    unused = [index for index, gene in enumerate(one.genes) if gene.path.startswith(beyond)]
    genome[unused] = np.random.default_rng(seed).random(len(unused))
    assert one.decode(genome) == scene


def moves(one: SearchSpace, scene: Scene) -> list[Scene]:
    """The scenes with one value a step nearer to nominal, or nominal where there are no steps."""
    values = one.composer.values(scene)
    found = []
    for path, value in values.items():
        gene = one.by_path[path]
        level = gene.grid.level(value)
        assert level is not None
        if gene.neutral or level == gene.grid.nominal_level:
            continue
        step = -1 if level > gene.grid.nominal_level else 1
        near = gene.grid.nominal if gene.kind == "category" else gene.grid.value(level + step)
        names = path.endswith(".object") and any(values[other] == near for other in values if other.endswith(".object"))
        if not names:  # a name that is taken cannot be moved to alone
            found.append(one.composer.compose(one.nominal_values | values | {path: near}))
    return found


@tasks
@quickly
@given(seed=seeds)
def test_severity_falls_when_any_one_value_moves_toward_nominal(task: str, seed: int) -> None:
    one = space(task)
    scene = one.sample(np.random.default_rng(seed))
    before = one.severity(scene)
    for nearer in moves(one, scene):
        assert one.severity(nearer) < before, nearer


@tasks
def test_the_nominal_scene_is_fair_and_has_no_severity(task: str) -> None:
    one = space(task)
    scene = one.nominal()
    assert check_static(scene, one.catalogue, one.operators.min_distance) is None
    assert set(one.severities(scene).values()) == {0.0}
    assert one.decode(one.encode(scene)) == scene
    assert scene.confounders == ()


def test_the_nominal_scene_of_the_same_objects_keeps_them() -> None:
    one = space("move-near")
    for scene in scenes("move-near", 5):
        nominal = one.nominal(like=scene)
        assert [target.object for target in nominal.targets] == [target.object for target in scene.targets]
        assert sum(share > 0 for share in one.severities(nominal).values()) <= 1


def test_a_camera_that_is_not_moved_has_no_direction() -> None:
    one = space("pick-up", "camera-position")
    assert one.dim == 3
    assert one.decode(np.array([0.0, 0.7, 0.7])).camera == Camera()
    moved = one.decode(np.array([1.0, 0.7, 0.7])).camera
    assert moved.distance == 0.05
    assert moved.azimuth != 0.0


def test_only_what_varies_has_genes() -> None:
    assert [gene.operator for gene in space("pick-up", "light").genes] == ["light"]
    assert space("pick-up").dim == 28
    assert space("put-in").dim == 33
    kinds = {gene.path: gene.kind for gene in space("put-in").genes}
    assert kinds["targets.1.yaw"] == "angle"
    assert kinds["confounders"] == "count"
    assert kinds["confounders.2.object"] == "category"
    assert kinds["light.intensity"] == "real"


def test_every_wording_comes_up() -> None:
    one = space("put-in", "wording", "target-type")
    said = {one.decode(np.array([0.0, 0.0, where])).instruction for where in np.linspace(0, 0.99, 10)}
    assert len(said) == 10


FIRST = scenes("pick-up", 1)[0]
(TARGET,) = FIRST.targets


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"task": "put-on"}, "task: 'put-on'"),
        ({"light": Light(1.02)}, "light.intensity: 1.02"),
        ({"camera": Camera(distance=0.2)}, "camera.distance: 0.2"),
        ({"camera": Camera(azimuth=10.0)}, "camera.azimuth: 10.0"),
        ({"instruction": "dance"}, "instruction: 'dance' is unknown"),
        ({"confounders": FIRST.targets * 5}, "confounders: 5"),
        ({"confounders": FIRST.targets}, "confounders.0.object"),
        ({"robot": "widowx"}, "robot: 'widowx'"),
        ({"targets": (replace(TARGET, x=0.00005),)}, "targets.0.x: 5e-05"),
        ({"targets": (replace(TARGET, yaw=-180.0),)}, "targets.0.yaw: -180.0"),
        ({"targets": (replace(TARGET, object="duck"),)}, "targets.0.object: 'duck' is unknown"),
        ({"targets": (replace(TARGET, rest="upside"),)}, "targets.0.rest: 'upside' is unknown"),
        ({"targets": (replace(TARGET, scale=0.5),)}, "targets.0.scale: 0.5"),
        ({"targets": FIRST.targets * 2}, "targets: pick-up has 1, the scene 2"),
        ({"targets": ()}, "targets: pick-up has 1, the scene 0"),
        ({"targets": (replace(TARGET, quaternion=(1.0, 0.0, 0.0, 0.0)),)}, "targets.0.rest"),
    ],
)
def test_a_scene_that_has_no_genome_is_an_error_that_names_the_value(changes, says: str) -> None:
    with pytest.raises(SceneError) as caught:
        space("pick-up").encode(replace(FIRST, **changes))
    assert says in caught.value.message


def test_a_value_that_does_not_vary_must_be_nominal() -> None:
    intensity = space("pick-up").by_path["light.intensity"].grid.value(9)
    scene = replace(space("pick-up").nominal(), light=Light(intensity))
    with pytest.raises(SceneError, match="light does not vary") as caught:
        space("pick-up", "camera-position").encode(scene)
    assert caught.value.hint == "vary light as well"


def apart(one: Scene, other: Scene) -> float:
    vectors = [space(one.task).embed(scene) for scene in (one, other)]
    return float(np.linalg.norm(vectors[0] - vectors[1]))


def turned(yaw: float) -> Scene:
    scene = space().nominal()
    return replace(scene, targets=(replace(scene.targets[0], yaw=yaw),))


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
    turns = (1.0, -179.0)
    near, far = ([replace(nominal, camera=Camera(distance, turn)) for turn in turns] for distance in (0.001, 0.05))
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


def test_strange_values_are_numbers_too_and_have_severities():
    changes = {"light": Light(1000.0), "instruction": "dance", "confounders": sampled(1)[0].targets}
    strange = replace(space().nominal(), **changes)
    quaternion = replace(strange.targets[0], quaternion=(1.0, 0.0, 0.0, 0.0), object="duck")
    assert np.isfinite(space().embed(replace(strange, targets=(quaternion,)))).all()
    shares = space().severities(strange)
    assert (shares["wording"], shares["light"]) == (1.0, 1.0)
    assert not any(math.isnan(share) for share in shares.values())
