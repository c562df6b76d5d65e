"""The objects can be grasped; in PhysX they are there as built, stay where they are put, and are as heavy as stated."""

from itertools import product

import numpy as np
import pytest
import sapien
from sapien import physx

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.model import Grasp, rotation_matrix

CATALOGUE = load_catalogue()


def found(name: str, rest: str) -> tuple[Grasp, ...]:
    """The grasps of a built-in object, looked for anew."""
    model, pose = CATALOGUE[name], CATALOGUE[name].stable_pose(rest)
    turn, lift = np.array(rotation_matrix(pose.quaternion)), np.array([0.0, 0.0, pose.height])
    balance = np.average([part.mean(axis=0) for part in model.parts], axis=0, weights=[np.ptp(p) for p in model.parts])
    return find_grasps([part @ turn.T + lift for part in model.parts], turn @ balance + lift)


def test_every_object_to_grasp_has_grasps_that_fit_the_gripper_the_best_one_first():
    for pose in (pose for name in CATALOGUE.graspable() for pose in CATALOGUE[name].stable_poses):
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


EVERY_POSE = [(model.name, pose.name) for model in map(CATALOGUE.__getitem__, CATALOGUE) for pose in model.stable_poses]


def body(model) -> physx.PhysxRigidDynamicComponent:
    material = physx.PhysxMaterial(model.friction, model.friction, 0.0)
    component = physx.PhysxRigidDynamicComponent()
    for file in model.collision:
        shape = physx.PhysxCollisionShapeConvexMesh(str(file), [1, 1, 1], material)
        shape.density = model.density
        component.attach(shape)
    return component


def turned(yaw: float) -> sapien.Pose:
    half = np.radians(yaw) / 2
    return sapien.Pose(q=[np.cos(half), 0, 0, np.sin(half)])


def settle(model, starts: list[sapien.Pose]) -> list[sapien.Pose]:
    """Where copies of a model are after one second, each relative to its start."""
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.timestep = 0.01
    table = physx.PhysxRigidStaticComponent()
    table.attach(physx.PhysxCollisionShapeBox([9, 9, 0.1], physx.PhysxMaterial(0.6, 0.6, 0.0)))
    entities = [sapien.Entity().add_component(table)] + [sapien.Entity().add_component(body(model)) for _ in starts]
    for entity, pose in zip(entities, [sapien.Pose([0, 0, -0.1]), *starts], strict=True):
        entity.pose = pose
        scene.add_entity(entity)
    for _ in range(100):
        scene.step()
    return [start.inv() * entity.pose for start, entity in zip(starts, entities[1:], strict=True)]


@pytest.mark.parametrize(("name", "rest"), EVERY_POSE)
def test_it_stays_where_it_is_put(name, rest):
    model = CATALOGUE[name]
    pose = model.stable_pose(rest)
    starts = [sapien.Pose([k - 4, 0, pose.height]) * turned(45 * k) * sapien.Pose(q=pose.quaternion) for k in range(8)]
    for moved in settle(model, starts):
        assert np.linalg.norm(moved.p) < 0.002
        assert 2 * np.degrees(np.arccos(min(1.0, abs(moved.q[0])))) < 2


@pytest.mark.parametrize("name", CATALOGUE.names())
def test_physics_keeps_every_corner_and_the_mass(name):
    model = CATALOGUE[name]
    component = body(model)
    for part, shape in zip(model.parts, component.collision_shapes, strict=True):
        assert len(shape.vertices) == len(part) <= 96
        assert np.allclose(np.sort(shape.vertices, axis=0), np.sort(part, axis=0), atol=1e-6)
    assert component.mass == pytest.approx(model.mass, rel=1e-4)


@pytest.mark.parametrize("place", ["plate", "large_plate", "table_cloth", "short_table_cloth", "basket"])
def test_a_can_that_lies_there_stays_there(place):
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    below, can = CATALOGUE[place], CATALOGUE["coke_can"]
    ground = body(below)
    ground.kinematic = True
    first, second = sapien.Entity().add_component(ground), sapien.Entity().add_component(body(can))
    lying = can.stable_pose("lying")
    top = {"plate": -0.001, "large_plate": -0.001, "basket": -0.0215}.get(place, below.vertices[:, 2].max())
    second.pose = sapien.Pose([0, 0, top + lying.height + 0.002]) * sapien.Pose(q=lying.quaternion)
    for entity in (first, second):
        scene.add_entity(entity)
    second.components[0].set_linear_velocity([0, 0.05, 0])
    for _ in range(200):
        scene.step()
    assert np.hypot(*second.pose.p[:2]) < 0.05
    assert second.pose.p[2] > 0
