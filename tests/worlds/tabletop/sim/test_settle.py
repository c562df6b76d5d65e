"""Settling: what does not stay as it was put is no fair scene, nor is one that is solved from the start."""

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, nominal, put
from vlafuzz.model.scene import Placement
from vlafuzz.worlds.tabletop.sim.objects import models_of
from vlafuzz.worlds.tabletop.sim.world import settle
from vlafuzz.worlds.tabletop.tasks import MOVE_NEAR, PICK_UP, TASKS, task


def rejected(*placements: Placement, task=PICK_UP):
    return settle(task, models_of(placements, CATALOGUE), placements)


def tilted(degrees: float) -> tuple[float, float, float, float]:
    half = np.radians(degrees) / 2
    return float(np.cos(half)), float(np.sin(half)), 0.0, 0.0


@pytest.mark.parametrize("name", TASKS)
def test_nominal_scenes_are_fair(name):
    assert rejected(*nominal(name).placements, task=task(name)) is None


@pytest.mark.parametrize(
    "placements",
    [
        CROWD.placements,
        (put("green_cube", 0.0, 0.1, quaternion=tilted(90)),),  # as imported
        (put("coke_can", 0.0, 0.1, scale=0.4),),
        (put("coke_can", 0.0, 0.1, scale=2.5),),
    ],
)
def test_what_stays_where_it_is_put_is_fair(placements):
    assert rejected(*placements) is None


@pytest.mark.parametrize(
    ("placements", "starts", "says"),
    [
        ([put("coke_can", 0.36, 0.1)], "coke_can at (0.360, 0.100) ", ""),  # the table ends at x = 0.35
        ([put("orange", 0.5, 0.0)], "orange", "fell to z = -"),
        ([put("coke_can", 0.0, 0.1, quaternion=tilted(35))], "coke_can", "cm while settling, more than 1 cm"),
        ([put("green_cube", 0.0, 0.1, quaternion=tilted(20))], "green_cube", "tipped by 20 degrees"),
        ([put("coke_can", 0.0, 0.1), put("apple", 0.02, 0.1)], "", ""),  # one inside the other
        ([put("sponge", 0.0, 0.0), put("orange", 0.37, 0.2)], "orange", ""),
    ],
)
def test_what_does_not_stay_is_named_with_what_it_does(placements, starts, says):
    rejection = rejected(*placements)
    assert rejection.check == "settling"
    assert rejection.reason.startswith(starts)
    assert says in rejection.reason


@pytest.mark.parametrize(("distance", "check"), [(0.06, "solved"), (0.09, None)])
def test_two_that_are_near_already_are_solved_before_anybody_acts(distance, check):
    rejection = rejected(put("green_cube", 0.0, 0.0), put("yellow_cube", 0.0, distance), task=MOVE_NEAR)
    assert (rejection and rejection.check) == check
    assert not rejection or rejection.reason == "move-near is solved at the start, before the policy acts"
