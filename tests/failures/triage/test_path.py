from dataclasses import replace

import numpy as np
import pytest

from tests.failures.triage.planted import SPACE, WITH_EXTRAS, Planted
from vlafuzz.errors import SceneError
from vlafuzz.failures.triage.path import Path, deviating, directed, free_genes
from vlafuzz.model import Backdrop, Camera, Light, Noise, Scene
from vlafuzz.model.scene import TargetTopple
from vlafuzz.worlds.manipulation.space import GROUPS

NOMINAL = SPACE.nominal()
TARGET = NOMINAL.targets[0]


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


def test_a_reset_to_a_reference_needs_its_targets():
    other = scene(targets=(replace(TARGET, object="sponge"),))
    with pytest.raises(SceneError, match="sponge cannot stand for"):
        SPACE.reset(NOMINAL, ["light"], other)


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


def target(**values) -> Scene:
    return replace(NOMINAL, targets=(replace(TARGET, **values),))


CASES = [
    (replace(NOMINAL, light=Light(0.4)), "light:dark"),
    (replace(NOMINAL, light=Light(1.2)), "light:bright"),
    (replace(NOMINAL, camera=Camera(0.03, 90.0, 10.0)), "camera-position:+y"),
    (replace(NOMINAL, camera=Camera(0.03, 20.0, -60.0)), "camera-position:-z"),
    (replace(NOMINAL, camera=Camera(yaw=-3.0)), "camera-orientation:-yaw"),
    (replace(NOMINAL, camera=Camera(roll=-1.3, pitch=1.1, yaw=0.4)), "camera-orientation:-roll,+pitch"),
    (target(x=0.05), "target-position:+x"),
    (target(x=-0.04, y=-0.1), "target-position:-y"),
    (target(yaw=-100.0), "target-orientation:-yaw"),
    (target(rest="lying", yaw=60.0), "target-orientation:lying"),
    (replace(NOMINAL, backdrop=Backdrop("checker", wall="red")), "backdrop:table-checker,wall-red"),
    (replace(NOMINAL, noise=Noise(blur=2.0, jpeg=95.0)), "sensor-noise:+blur"),
    (replace(NOMINAL, target_topple=TargetTopple("approach", "lying")), "target-topple:rest-lying"),
]


@pytest.mark.parametrize(("scene", "says"), CASES, ids=[says for _, says in CASES])
def test_an_operator_is_named_with_its_direction(scene: Scene, says: str):
    assert directed(WITH_EXTRAS, scene, [says.partition(":")[0]]) == [says]


def test_confounders_have_their_number_and_their_kinds_where_these_matter():
    scene = SPACE.composer.compose(SPACE.nominal_values | {"confounders": 2})
    assert directed(SPACE, scene, ["confounders"]) == ["confounders:2"]
    changed = replace(scene.confounders[1], object="yellow_cube", rest="flat")
    other = replace(scene, confounders=(scene.confounders[0], changed))
    assert directed(SPACE, other, ["confounders"]) == ["confounders:2,cube"]


def test_a_direction_is_one_from_the_reference():
    reference = replace(NOMINAL, light=Light(0.2), camera=Camera(yaw=4.0))
    scene = replace(NOMINAL, light=Light(0.5), camera=Camera(yaw=2.0))
    operators = ["light", "camera-orientation"]
    assert directed(SPACE, scene, operators) == ["light:dark", "camera-orientation:+yaw"]
    assert directed(SPACE, scene, operators, reference) == ["light:bright", "camera-orientation:-yaw"]


@pytest.mark.parametrize("azimuth", [0.0, 60.0, 135.0])
def test_of_a_minimal_scene_the_camera_has_the_axis_that_matters_not_the_longest(azimuth: float):
    """The policy fails where the camera is 1.5 cm lower, however far it is aside."""
    scene = replace(NOMINAL, camera=Camera(0.045, azimuth, -25.0))
    policy = Planted([lambda scene: scene.camera.offset[2] <= -0.015])
    minimal = policy.shrunk(scene).scene
    assert directed(SPACE, scene, ["camera-position"]) != ["camera-position:-z"]
    assert directed(SPACE, minimal, ["camera-position"]) == ["camera-position:-z"]
    assert minimal.camera.offset[:2] == pytest.approx((0, 0), abs=1e-9)


def test_the_second_target_has_its_number():
    space = type(SPACE)(SPACE.operators, SPACE.catalogue, "put-on")
    nominal = space.nominal()
    moved = replace(nominal, targets=(nominal.targets[0], replace(nominal.targets[1], y=0.05)))
    assert directed(space, moved, ["target-position"]) == ["target-position:-y2"]
