"""The objects can be grasped; in PhysX they are there as built, stay where they are put, and are as heavy as stated."""

from itertools import product

import numpy as np
import pytest
import sapien
from sapien import physx

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps

CATALOGUE = load_catalogue()
POSES = [(name, pose.name) for name in CATALOGUE.graspable() for pose in CATALOGUE[name].stable_poses]


@pytest.mark.parametrize(("name", "rest"), POSES)
def test_it_can_be_grasped(name, rest):
    pose = CATALOGUE[name].stable_pose(rest)
    assert 1 <= len(pose.grasps) <= 12
    assert pose.grasps[0].width <= 0.072
    assert [g.quality for g in pose.grasps] == sorted((g.quality for g in pose.grasps), reverse=True)
    for grasp in pose.grasps:
        assert grasp.width <= 0.074
        assert 0 <= grasp.yaw < 180
        assert 0 < grasp.quality <= 1
        assert max(0.012, pose.top - 0.034) <= grasp.z + 1e-4
        assert grasp.z < pose.top


def test_a_round_object_can_be_grasped_from_everywhere():
    grasps = CATALOGUE["coke_can"].stable_pose("standing").grasps
    assert {g.yaw for g in grasps} == {15.0 * k for k in range(12)}
    assert len({g.quality for g in grasps}) == 1


@pytest.mark.parametrize(("name", "rest"), [("coke_can", "lying"), ("sponge", "flat"), ("spoon", "lying")])
def test_a_long_object_is_grasped_across(name, rest):
    assert CATALOGUE[name].stable_pose(rest).grasps[0].yaw == 90


def test_a_cube_is_grasped_by_its_faces():
    assert {g.yaw for g in CATALOGUE["green_cube"].stable_pose("flat").grasps} == {0, 90}


def test_the_best_grasp_is_near_the_centre_of_mass():
    (bottle,) = (CATALOGUE["blue_plastic_bottle"].stable_pose("lying"),)
    assert bottle.grasps[0].x == pytest.approx(0.025, abs=0.01)  # the body weighs more than the neck
    assert CATALOGUE["sponge"].stable_pose("flat").grasps[0].x == pytest.approx(0, abs=1e-3)


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
