import numpy as np
import pytest

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.shapes import _box as box

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
