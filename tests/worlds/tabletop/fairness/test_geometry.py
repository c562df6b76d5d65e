from dataclasses import replace

import pytest

from vlafuzz.model.scene import Camera, Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.fairness import check_geometry, check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue

CATALOGUE = load_catalogue()
NOMINAL = Camera()


def scene(*placements: Placement, camera: Camera = NOMINAL) -> Scene:
    return Scene("pick-up", placements[:1], "do it", confounders=placements[1:], camera=camera)


def can(x: float, y: float, rest: str = "standing", yaw: float = 0.0) -> Placement:
    return Placement("coke_can", rest, x, y, yaw)


def reason(scene: Scene, min_distance: float = 0.15) -> str:
    rejection = check_geometry(scene, CATALOGUE, min_distance)
    assert rejection is not None
    assert rejection.check == "geometry"
    return rejection.reason


def test_a_fair_scene_passes() -> None:
    fair = scene(can(0, 0), Placement("apple", "resting", 0.09, 0.12))
    assert check_geometry(fair, CATALOGUE, 0.15) is None
    assert check_static(fair, CATALOGUE, 0.15) is None


def test_centres_keep_the_distance() -> None:
    near = scene(can(0, 0), Placement("apple", "resting", 0.1, 0.0))
    assert reason(near) == "coke can and apple: 0.100 m between their centres, less than 0.15 m"
    assert check_geometry(near, CATALOGUE, 0.1) is None


def test_footprints_do_not_overlap_though_centres_keep_the_distance() -> None:
    bottle = Placement("blue_plastic_bottle", "lying", 0.0, 0.13, 90.0)
    both = scene(can(0, 0), bottle)
    assert reason(both, 0.1) == "coke can and blue plastic bottle: their footprints overlap"
    assert check_geometry(scene(can(0, 0), replace(bottle, yaw=0.0)), CATALOGUE, 0.1) is None


def test_the_whole_footprint_is_inside_the_workspace() -> None:
    assert check_geometry(scene(can(0.12, 0.0)), CATALOGUE, 0.15) is None
    ends = "the workspace ends at -0.24 and 0.16 m"
    assert reason(scene(can(0.12, 0.0, "lying"))) == f"coke can: covers x from 0.058 to 0.181 m, {ends}"
    assert reason(scene(can(0, 0), Placement("apple", "resting", 0.0, 0.28))).startswith("apple: covers y")
    assert check_geometry(scene(can(0.12, 0.0, "lying", 90.0)), CATALOGUE, 0.15) is None


def test_targets_are_within_reach_and_confounders_need_not_be() -> None:
    far, near = Placement("green_cube", "flat", 0.14, 0.28), can(0.0, 0.0)
    assert reason(scene(far)) == "green cube: 0.805 m from the panda's base, its reach is 0.79 m"
    assert check_geometry(scene(near, far), CATALOGUE, 0.15) is None
    assert PANDA.reach == 0.79


@pytest.mark.parametrize("camera", [Camera(yaw=40.0), Camera(pitch=-60.0), Camera(yaw=180.0)])
def test_targets_are_in_the_view_of_the_scenes_own_camera(camera: Camera) -> None:
    assert check_geometry(scene(can(0, 0)), CATALOGUE, 0.15) is None
    seen = reason(scene(can(0, 0), camera=camera))
    assert seen == "coke can: 0% of it is in view; 90% and its centre must be"
