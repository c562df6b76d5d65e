import numpy as np
import pytest

from vlafuzz.errors import SimulatorError, UsageError
from vlafuzz.model import Monitor
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.packages import load, quiet
from vlafuzz.worlds.libero.pictures import CAMERAS
from vlafuzz.worlds.libero.stages import Moment, find_stages
from vlafuzz.worlds.libero.suites import find_task, find_tasks, initial_states

pytestmark = pytest.mark.libero
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (8, 7))


def rolled(env: LiberoEnv, number: int) -> list[list[float]]:
    env.reset(number)
    states = []
    for action in ACTIONS:
        env.step(action)
        states.append(env.state().tolist())
    return states


def test_states_observations_and_pictures_are_those_of_libero_bit_by_bit(bowls):
    with quiet():
        size = {"camera_heights": 64, "camera_widths": 64}
        theirs = load("libero.libero.envs").OffScreenRenderEnv(bddl_file_name=str(bowls.task.bddl), **size)
    theirs.seed(0)
    theirs.reset()
    seen = [theirs.set_init_state(bowls.states[3])]
    expected = []
    for action in ACTIONS:
        seen.append(theirs.step(action)[0])
        expected.append(theirs.get_sim_state().tolist())
    theirs.close()
    assert rolled(bowls, 3) == expected
    state, pictures = bowls.proprioception(), bowls.pictures()
    assert state[:3].tolist() == seen[-1]["robot0_eef_pos"].tolist()
    assert state[6:].tolist() == seen[-1]["robot0_gripper_qpos"].tolist()
    for camera in CAMERAS:
        assert np.array_equal(pictures[camera], seen[-1][f"{camera}_image"][::-1, ::-1])


def test_stages_follow_one_another_and_the_goal_implies_them(bowls):
    bowls.reset()
    moment, monitor = Moment(bowls), Monitor(find_stages(bowls.task))
    monitor.observe(moment)
    assert monitor.reached == []
    put_bowl_on_plate(bowls)
    monitor.observe(moment)
    assert not monitor.success_once  # for one step only
    bowls.settle(1)
    monitor.observe(moment)
    assert monitor.reached == ["reach", "grasp", "move", "goal"]


def put_bowl_on_plate(env: LiberoEnv) -> None:
    bowl, plate = (env.data.joint(f"{name}_joint0") for name in ("akita_black_bowl_1", "plate_1"))
    bowl.qpos[:3] = plate.qpos[:3] + np.array([0.0, 0.0, 0.02])
    env.settle(10)


def test_stages_of_several_things_are_numbered():
    names = tuple(stage.name for stage in find_stages(find_task("libero_10/0")))
    assert names == ("reach 1", "grasp 1", "move 1", "reach 2", "grasp 2", "move 2", "goal")


@pytest.mark.parametrize(
    ("name", "instruction", "goal"),
    [
        ("libero_goal/0", "open the middle drawer of the cabinet", "wooden_cabinet_1_middle_region"),
        ("libero_goal_task/0", "open the bottom drawer of the cabinet", "wooden_cabinet_1_bottom_region"),
        ("libero_goal_lan/7", "switch on the stove", "flat_stove_1"),
    ],
)
def test_where_the_words_are_what_is_new_they_are_those_of_the_problem(name, instruction, goal):
    """The files of a suite and of its variants have the same names, from which LIBERO takes instructions."""
    task = find_task(name)
    assert (task.instruction, task.goal[0][1]) == (instruction, goal)


def test_an_unusable_action_or_state_is_refused(bowls):
    with pytest.raises(SimulatorError, match="seven finite numbers"):
        bowls.step(np.full(7, np.nan))
    with pytest.raises(UsageError, match="no initial state 50"):
        bowls.reset(50)


def test_a_suite_has_its_tasks_with_instruction_goal_and_initial_states():
    task = find_tasks("libero_object")[0]
    assert str(task) == "libero_object/0"
    assert task.instruction == "pick up the alphabet soup and place it in the basket"
    assert task.goal == (("in", "alphabet_soup_1", "basket_1_contain_region"),)
    assert task.horizon == 280
    assert len(initial_states(task)) == 50


@pytest.mark.parametrize(
    ("name", "hint"),
    [("libero_objects/0", "libero_object"), ("libero_object/10", "libero_object/9"), ("libero_object", "/9")],
)
def test_an_unknown_task_is_named_with_a_hint(name, hint):
    with pytest.raises(UsageError) as raised:
        find_task(name)
    assert hint in str(raised.value.hint)
