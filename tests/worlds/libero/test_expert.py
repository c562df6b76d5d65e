from itertools import islice

import numpy as np
import pytest

from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.expert import Expert, can_solve
from vlafuzz.worlds.libero.grasps import find_grasps
from vlafuzz.worlds.libero.stages import Moment, monitor_of
from vlafuzz.worlds.libero.suites import SETTLING, find_task

pytestmark = pytest.mark.libero


def rollout(env: LiberoEnv, actions) -> list[str]:
    moment, monitor = Moment(env), monitor_of(env)
    for action in actions:
        assert np.abs(action).max() <= 1.0
        env.step(action)
        monitor.observe(moment)
        if monitor.success_once:
            break
    return monitor.reached


def test_the_expert_puts_the_bowl_on_the_plate_by_all_stages(bowls):
    bowls.reset(1)
    bowls.settle(SETTLING)
    assert rollout(bowls, islice(Expert(bowls).actions(), bowls.task.horizon)) == ["reach", "grasp", "move", "goal"]


def test_a_bowl_is_taken_by_its_rim(bowls):
    bowls.reset()
    bowls.settle(SETTLING)
    place = bowls.data.body("akita_black_bowl_1_main").xpos
    best = find_grasps(bowls, "akita_black_bowl_1")[0]
    assert 0.03 < np.linalg.norm((best.position - place)[:2]) < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("name", ["libero_goal/0", "libero_goal/3", "libero_goal/5", "libero_goal/7", "libero_10/9"])
def test_what_must_be_pushed_or_opened_is_without_an_expert(name):
    env = LiberoEnv(find_task(name))
    assert not can_solve(env)
    env.close()
