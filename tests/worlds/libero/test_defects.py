import re

import numpy as np
import pytest

from vlafuzz.errors import UsageError
from vlafuzz.worlds.libero.defects import broken_premises, defects
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.suites import find_task

pytestmark = pytest.mark.libero


def reasons(env: LiberoEnv) -> list[str]:
    return [defect.reason for defect in broken_premises(env)]


def test_the_bowl_that_cannot_stay_on_the_ramekin_is_found():
    env = LiberoEnv(find_task("libero_spatial/5"), size=64)
    found = {defect.check: defect.reason for defect in defects(env, env.reset)}
    env.close()
    assert found["slides"].startswith("akita_black_bowl_1 slides by ")
    assert found["falls"].startswith("akita_black_bowl_1 topples by ")
    assert found["premise"] == "akita_black_bowl_1 is not on glazed_rim_porcelain_ramekin_1"


def test_a_sound_state_has_no_defects_and_is_watched_until_nothing_moves(bowls):
    assert list(defects(bowls, bowls.reset)) == []
    assert bowls.steps < 30  # of 40


def test_what_still_moves_is_watched_on(bowls):
    """A bowl that falls from three metres above the table comes down after 0.8 seconds."""

    def lifted() -> None:
        bowls.reset()
        bowls.data.joint("akita_black_bowl_1_joint0").qpos[2] += 3.0

    found = {defect.check: defect.reason for defect in defects(bowls, lifted)}
    assert re.fullmatch(r"akita_black_bowl_1 still moves by [1-3]\d\d\.\d cm", found["moving"])
    assert bowls.steps > 20


def test_a_task_that_the_package_cannot_build_is_refused():
    with pytest.raises(UsageError, match=r"libero_10_with_milk/3 cannot be set up: .*milk_1"):
        LiberoEnv(find_task("libero_10_with_milk/3"))  # it names the milk twice


def test_a_thing_that_is_not_where_the_problem_says_is_named(bowls):
    bowls.reset()
    bowls.settle(10)
    assert reasons(bowls) == []
    bowls.data.joint("akita_black_bowl_1_joint0").qpos[:2] += np.array([0.1, 0.0])
    bowls.settle(1)
    (defect,) = broken_premises(bowls)
    assert defect.check == "region"
    assert defect.reason.startswith("akita_black_bowl_1 is not on main_table_")


def test_a_bowl_on_the_microwave_is_there_although_liberos_region_hovers_above_it():
    env = LiberoEnv(find_task("libero_90/36"), size=64)
    env.reset()
    env.settle(10)
    assert not env.holds(("on", "white_bowl_1", "microwave_1_top_side"))
    assert reasons(env) == []
    env.data.joint("white_bowl_1_joint0").qpos[1] += 0.15
    env.settle(1)
    assert reasons(env) == ["white_bowl_1 is not on microwave_1_top_side"]
    env.close()


def test_a_double_counts_where_the_words_fit_it_clearly_or_better_than_the_target():
    """The other bowl stands beside the ramekin, always 24 to 30 cm from the plate: the target is meant."""
    env = LiberoEnv(find_task("libero_spatial/8"), size=64)

    def misled(*places: tuple[float, float]) -> list[str]:
        """By the places of both bowls, as metres beside the plate."""
        env.reset()
        plate = env.data.joint("plate_1_joint0").qpos[:2]
        for bowl, away in zip(("akita_black_bowl_1_joint0", "akita_black_bowl_2_joint0"), places, strict=True):
            env.data.joint(bowl).qpos[:2] = plate + np.array(away)
        env.settle(1)
        return [reason for reason in reasons(env) if reason.endswith("too")]

    too = ["akita_black_bowl_2 is next to the plate, too"]
    assert misled((0.0, 0.14), (0.0, -0.24)) == []
    assert misled((0.0, 0.14), (0.14, 0.0)) == too
    assert misled((0.0, 0.23), (0.0, -0.2)) == too
    env.close()


def test_what_touches_the_rim_of_a_plate_is_next_to_it():
    env = LiberoEnv(find_task("libero_spatial/8"), size=64)
    env.reset(15)  # the suite's own: the bowl stands on the table, at the plate
    env.settle(10)
    bowl, plate = (env.robosuite.get_object(name) for name in ("akita_black_bowl_1", "plate_1"))
    assert env.robosuite.check_contact(bowl, plate)
    assert reasons(env) == []
    env.close()
