"""Where objects stand: distances, workspace, reach and view, by their outlines on the table."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial import ConvexHull

from vlafuzz.model import Camera, Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.fairness import check_geometry, check_static
from vlafuzz.worlds.tabletop.fairness.footprint import apart, extents, footprint, solid
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


quickly = settings(max_examples=20, derandomize=True, deadline=None, database=None)


def cube(x: float, y: float = 0.0, yaw: float = 0.0) -> Placement:
    return Placement("green_cube", "flat", x, y, yaw)


@pytest.mark.parametrize(
    ("x", "y", "yaw", "expected"),
    [
        (0.0305, 0, 0, True),
        (0.0295, 0, 0, False),
        (0.0365, 0, 45, True),
        (0.0355, 0, 45, False),
        (0.031, 0.031, 0, True),  # corner to corner
    ],
)
def test_two_cubes_are_apart_when_their_sides_are(x: float, y: float, yaw: float, expected: bool) -> None:
    model = CATALOGUE["green_cube"]
    a, b = footprint(cube(0.0), model), footprint(cube(x, y, yaw), model)
    assert apart(a, b) == apart(b, a) == expected


rests, offset = st.sampled_from(["flat", "on_edge"]), st.floats(-0.1, 0.1)
placements = st.builds(Placement, st.just("sponge"), rests, offset, offset, st.floats(-180, 180))


@quickly
@given(a=placements, b=placements)
def test_apart_agrees_with_a_fine_sampling_of_points(a: Placement, b: Placement) -> None:
    first, second = footprint(a, CATALOGUE["sponge"]), footprint(b, CATALOGUE["sponge"])
    weights = np.random.default_rng(0).dirichlet(np.ones(4), 400)
    inside = weights @ first.polygon
    equations = ConvexHull(second.polygon).equations
    shared = np.all(inside @ equations[:, :2].T + equations[:, 2] < -1e-9, axis=1).any()
    if shared:
        assert not apart(first, second)
    assert apart(first, second) == apart(second, first)


@quickly
@given(placement=placements)
def test_a_footprint_is_the_shadow_of_the_solid(placement: Placement) -> None:
    model = CATALOGUE["sponge"]
    outline, points = footprint(placement, model), solid(placement, model)
    assert outline.polygon.min(axis=0) == pytest.approx(points[:, :2].min(axis=0), abs=1e-6)
    assert outline.polygon.max(axis=0) == pytest.approx(points[:, :2].max(axis=0), abs=1e-6)
    assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6)


def test_scale_scales_about_the_objects_place() -> None:
    model = CATALOGUE["sponge"]
    half = footprint(Placement("sponge", "flat", 0.1, 0.0, scale=0.5), model)
    assert half.polygon.max(axis=0) == pytest.approx([0.125, 0.0175])
    assert half.radius == pytest.approx(footprint(Placement("sponge", "flat", 0, 0), model).radius / 2)


def test_a_raw_quaternion_replaces_rest_pose_and_yaw() -> None:
    model = CATALOGUE["sponge"]
    rest = model.stable_pose("on_edge")
    w, x, y, z = map(float, rest.quaternion)
    raw = Placement("sponge", "flat", 0.0, 0.0, 77.0, quaternion=(w, x, y, z))
    named = replace(raw, rest="on_edge", yaw=0.0, quaternion=None)
    assert np.ptp(footprint(raw, model).polygon, axis=0) == pytest.approx([0.1, 0.036], abs=1e-6)
    assert solid(raw, model) == pytest.approx(solid(named, model), abs=1e-6)


def test_extents_are_along_and_across() -> None:
    sides = extents(footprint(Placement("sponge", "flat", 0, 0), CATALOGUE["sponge"]).polygon)
    assert sides[0] == pytest.approx([0.1, 0.07], abs=1e-6)
    assert sides[45] == pytest.approx([0.07, 0.1], abs=1e-6)
