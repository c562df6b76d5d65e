"""The objects can be grasped; in PhysX they are there as built, stay where they are put, and are as heavy as stated."""

from itertools import product

import numpy as np
import pytest
import sapien
from sapien import physx

from tests.worlds.tabletop.sim.scenes import CATALOGUE, pick_up, put
from vlafuzz.worlds.manipulation.rotations import rotation_matrix
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.model import Grasp
from vlafuzz.worlds.tabletop.sim.world import add_object, settled


def found(name: str, rest: str) -> tuple[Grasp, ...]:
    """The grasps of a built-in object, looked for anew."""
    model, pose = CATALOGUE[name], CATALOGUE[name].stable_pose(rest)
    turn, lift = np.array(rotation_matrix(pose.quaternion)), np.array([0.0, 0.0, pose.height])
    balance = np.average([part.mean(axis=0) for part in model.parts], axis=0, weights=[np.ptp(p) for p in model.parts])
    return find_grasps([part @ turn.T + lift for part in model.parts], turn @ balance + lift)


def test_every_object_to_grasp_has_grasps_that_fit_the_gripper_the_best_one_first():
    for pose in (pose for name in CATALOGUE.names("graspable") for pose in CATALOGUE[name].stable_poses):
        assert 1 <= len(pose.grasps) <= 12
        assert max(grasp.width for grasp in pose.grasps) <= 0.074
        assert all(pose.top - 0.034 <= grasp.z + 1e-4 < pose.top for grasp in pose.grasps)
        qualities = [grasp.quality for grasp in pose.grasps]
        assert qualities == sorted(qualities, reverse=True)


@pytest.mark.parametrize(
    ("name", "rest", "yaws"),
    [
        ("coke_can", "standing", {15.0 * k for k in range(12)}),  # from everywhere
        ("sponge", "flat", {90.0}),  # across
        ("green_cube", "flat", {0.0, 90.0}),  # by its faces
    ],
)
def test_an_object_is_grasped_where_it_is_narrow(name, rest, yaws):
    grasps = found(name, rest)
    assert {grasp.yaw for grasp in grasps} == yaws
    assert np.hypot(grasps[0].x, grasps[0].y) < 0.01  # near the centre of mass


def box(size, centre) -> np.ndarray:
    return np.array(list(product((-0.5, 0.5), repeat=3))) * size + centre


@pytest.mark.parametrize(
    ("size", "possible"),
    [((0.03, 0.03, 0.03), True), ((0.09, 0.09, 0.03), False), ((0.2, 0.03, 0.03), True), ((0.03, 0.03, 0.002), False)],
)
def test_what_is_too_wide_for_the_gripper_has_no_grasp(size, possible):
    centre = np.array([0, 0, size[2] / 2])
    assert bool(find_grasps([box(size, centre)], centre)) == possible


def test_a_finger_does_not_come_down_on_a_ledge():
    # A bar that the gripper could close on, above a board that is in the fingers' way
    bar, board = box((0.03, 0.03, 0.05), (0, 0, 0.035)), box((0.1, 0.1, 0.01), (0, 0, 0.005))
    centre = np.array([0, 0, 0.02])
    low = [g.z for g in find_grasps([bar, board], centre)]
    assert low
    assert min(low) >= 0.018


def test_every_object_stays_where_it_is_put_in_every_pose():
    for name in CATALOGUE:
        for pose in CATALOGUE[name].stable_poses:
            for yaw in range(0, 360, 90):
                assert settled(pick_up(put(name, 0.0, 0.0, yaw, pose.name)), CATALOGUE) is None


def body(scene: sapien.Scene, name: str, rest: str | None = None) -> physx.PhysxRigidDynamicComponent:
    return add_object(scene, CATALOGUE[name], put(name, 0.0, 0.0, rest=rest), name)


@pytest.mark.parametrize("name", CATALOGUE.names())
def test_physics_keeps_every_corner_and_the_mass(name):
    model, component = CATALOGUE[name], body(sapien.Scene([physx.PhysxCpuSystem()]), name)
    for part, shape in zip(model.parts, component.collision_shapes, strict=True):
        assert len(shape.vertices) == len(part) <= 96
        assert np.allclose(np.sort(shape.vertices, axis=0), np.sort(part, axis=0), atol=1e-6)
    assert component.mass == pytest.approx(model.mass, rel=1e-4)


@pytest.mark.parametrize("place", ["plate", "large_plate", "table_cloth", "short_table_cloth", "basket"])
def test_a_can_that_lies_there_stays_there(place):
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    below, can = body(scene, place), body(scene, "coke_can", "lying")
    below.kinematic = True
    vertices, lying = CATALOGUE[place].vertices, CATALOGUE["coke_can"].stable_pose("lying")
    top = {"plate": -0.001, "large_plate": -0.001, "basket": -0.0215}.get(place, vertices[:, 2].max())
    height = below.entity.pose.p[2] + top + lying.height + 0.002
    can.entity.pose = sapien.Pose([0, 0, height], can.entity.pose.q)
    can.set_linear_velocity([0, 0.05, 0])
    for _ in range(200):
        scene.step()
    assert np.hypot(*can.entity.pose.p[:2]) < 0.05
    assert can.entity.pose.p[2] > below.entity.pose.p[2]
