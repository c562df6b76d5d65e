"""Settling: what does not stay as it was put is no fair scene, nor is one that is solved from the start."""

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, nominal, put
from vlafuzz.model.scene import Placement
from vlafuzz.worlds.tabletop.sim.objects import models_of
from vlafuzz.worlds.tabletop.sim.settle import settle
from vlafuzz.worlds.tabletop.tasks import MOVE_NEAR, PICK_UP, TASKS, task


def rejected(*placements: Placement, task=PICK_UP):
    return settle(task, models_of(placements, CATALOGUE), placements).rejection


def tilted(degrees: float) -> tuple[float, float, float, float]:
    half = np.radians(degrees) / 2
    return float(np.cos(half)), float(np.sin(half)), 0.0, 0.0


@pytest.mark.parametrize("name", TASKS)
def test_nominal_scenes_are_fair(name):
    assert rejected(*nominal(name).placements, task=task(name)) is None


def test_a_crowded_table_is_fair():
    assert rejected(*CROWD.placements) is None


def test_a_can_whose_middle_is_over_the_tables_edge_does_not_stay():
    rejection = rejected(put("coke_can", 0.36, 0.1))  # the table ends at x = 0.35
    assert rejection.check == "settling"
    assert rejection.reason.startswith("coke_can at (0.360, 0.100) ")


def test_what_is_put_beside_the_table_falls():
    assert "fell to z = -" in rejected(put("orange", 0.5, 0.0)).reason


def test_a_can_that_leans_moves():
    rejection = rejected(put("coke_can", 0.0, 0.1, quaternion=tilted(35)))
    assert rejection.check == "settling"
    assert "cm while settling, more than 1 cm" in rejection.reason


def test_a_cube_that_stands_on_its_edge_tips():
    rejection = rejected(put("green_cube", 0.0, 0.1, quaternion=tilted(20)))
    assert (rejection.check, "tipped by 20 degrees" in rejection.reason) == ("settling", True)


def test_an_imported_quaternion_that_rests_is_fair():
    assert rejected(put("green_cube", 0.0, 0.1, quaternion=tilted(90))) is None


@pytest.mark.parametrize("scale", [0.4, 2.5])
def test_a_scaled_object_stands_on_its_own_size(scale):
    assert rejected(put("coke_can", 0.0, 0.1, scale=scale)) is None


def test_an_object_inside_another_is_pushed_out():
    assert rejected(put("coke_can", 0.0, 0.1), put("apple", 0.02, 0.1)).check == "settling"


def test_the_object_that_moves_is_named():
    assert rejected(put("sponge", 0.0, 0.0), put("orange", 0.37, 0.2)).reason.startswith("orange")


@pytest.mark.parametrize(("distance", "check"), [(0.06, "solved"), (0.09, None)])
def test_two_that_are_near_already_are_solved_before_anybody_acts(distance, check):
    rejection = rejected(put("green_cube", 0.0, 0.0), put("yellow_cube", 0.0, distance), task=MOVE_NEAR)
    assert (rejection and rejection.check) == check


def test_a_solved_scene_says_which_task_and_when():
    rejection = rejected(put("green_cube", 0.0, 0.0), put("yellow_cube", 0.0, 0.06), task=MOVE_NEAR)
    assert rejection.reason == "move-near is solved at the start, before the policy acts"
