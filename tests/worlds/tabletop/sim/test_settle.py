"""Settling: what does not stay as it was put is no fair scene, nor is one that is solved from the start."""

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, make_env, nominal, pick_up, put
from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator, settled
from vlafuzz.worlds.tabletop.sim.objects import models_of, resting_pose
from vlafuzz.worlds.tabletop.sim.settle import settle, start_poses
from vlafuzz.worlds.tabletop.tasks import MOVE_NEAR, PICK_UP, TASKS, task


def rejected(*placements: Placement, task=PICK_UP):
    return settle(task, models_of(placements, CATALOGUE), placements).rejection


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


LEANING = pick_up(put("coke_can", -0.05, 0.0, quaternion=(0.9537, 0.3007, 0.0, 0.0)))  # by 35 degrees


def shifts(scene: Scene, *, dropped: bool = True) -> list[float]:
    """How far each object then is from where the scene has it, metres."""
    models = models_of(scene.placements, CATALOGUE)
    poses = start_poses(scene, models, PANDA, dropped=dropped)
    wanted = [resting_pose(*pair)[0] for pair in zip(models, scene.placements, strict=True)]
    return [float(np.linalg.norm(pose.p - place)) for pose, place in zip(poses, wanted, strict=True)]


def test_what_has_room_falls_where_the_scene_has_it():
    scene = pick_up(put("coke_can", -0.05, 0.0), put("sponge", 0.05, 0.2), put("pepsi_can", 0.0, -0.2, 30.0, "lying"))
    assert max(shifts(scene)) < 0.005
    assert max(shifts(scene, dropped=False)) < 1e-6


def test_what_falls_onto_others_ends_elsewhere():
    assert max(shifts(pick_up(put("green_cube", 0.0, 0.0), put("apple", 0.03, 0.0)))) > 0.02


def test_in_pick_up_the_others_fall_after_the_target_and_in_the_other_tasks_with_it():
    """Two cubes at one place: one on top of the other, or thrown apart."""
    two = (put("green_cube", 0.0, 0.0), put("yellow_cube", 0.001, 0.001))
    models = models_of(two, CATALOGUE)
    heights = [
        start_poses(scene, models, PANDA, dropped=True)[1].p[2]
        for scene in (pick_up(*two), Scene("move-near", two, "move it"))
    ]
    assert heights == pytest.approx([0.045, 0.015], abs=2e-3)


def test_the_simulator_begins_with_what_fell_and_says_so():
    env = make_env(placement="published")
    env.begin(LEANING)
    env.applied().check(LEANING, env.poses, env.rig)
    hashes = {env.world.states_hash for _ in range(2) if env.begin(LEANING)}
    (pose,) = env.applied().poses
    env.close()
    assert len(hashes) == 1
    assert abs(pose.to_transformation_matrix()[2, 2]) < 0.01  # it no longer leans, it lies


def test_a_can_that_leans_is_fair_where_it_may_fall():
    assert settled(LEANING, CATALOGUE).rejection.check == "settling"
    fallen = settled(LEANING, CATALOGUE, "published")
    assert (fallen.rejection, fallen.solved) == (None, False)
    evaluator = ManiSkillEvaluator(
        Conditions(task="pick-up", world={"min_distance": 0.1, "placement": "published"}), Expert(), CATALOGUE
    )
    (outcome,) = evaluator.evaluate([LEANING])
    evaluator.close()
    assert outcome.verdict is Verdict.PASSED


def test_what_falls_off_the_table_is_no_fair_scene():
    rejection = settled(pick_up(put("orange", 0.37, 0.0)), CATALOGUE, "published").rejection
    assert "fell to z = -" in rejection.reason


def test_there_are_two_placements():
    with pytest.raises(UsageError, match="unknown placement 'dropped'"):
        make_env(placement="dropped")
