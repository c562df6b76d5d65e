"""The metric controller: the hand does what is commanded, in metres, radians and the base's axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.worlds.tabletop.sim.scenes import make_env, pick_up, play, put, turn

ASIDE = pick_up(put("green_cube", 0.12, 0.27))
MILLIMETRES, RADIANS = 0.002, 0.02
UNITS = {"x": 0, "y": 1, "z": 2, "roll": 3, "pitch": 4, "yaw": 5}


def command(gripper: float = 1.0, **deltas: float) -> np.ndarray:
    action = np.zeros(7)
    action[6] = gripper
    for name, delta in deltas.items():
        action[UNITS[name]] = delta
    return action


@pytest.fixture
def start(env):
    return env.begin(ASIDE)


def check(start, end, *, move=(0, 0, 0), turned=(0, 0, 0)) -> None:
    assert end.tcp - start.tcp == pytest.approx(np.array(move, dtype=float), abs=MILLIMETRES)
    assert turn(start, end) == pytest.approx(np.array(turned, dtype=float), abs=RADIANS)


@pytest.mark.parametrize("sign", [1, -1], ids="+-")
@pytest.mark.parametrize("axis", UNITS)
def test_a_command_moves_the_hand_along_or_turns_it_about_the_bases_axis_and_nothing_else(env, start, axis, sign):
    delta = sign * (0.05 if len(axis) == 1 else 0.2)
    end = play(env, [command(**{axis: delta})], still=4)
    expected = np.eye(6)[UNITS[axis]] * delta
    check(start, end, move=expected[:3], turned=expected[3:])
    assert end.opening == pytest.approx(0.08, abs=MILLIMETRES)


def test_the_gripper_closes_and_opens_and_the_hand_stays(env, start):
    closed = play(env, [command(gripper=-1)], still=3)
    assert closed.opening == pytest.approx(0.0, abs=MILLIMETRES)
    reopened = play(env, [command(gripper=1)], still=3)
    assert reopened.opening == pytest.approx(0.08, abs=MILLIMETRES)
    check(start, reopened)


def test_three_angles_are_one_rotation_vector_and_no_euler_angles(env, start):
    vector = [0.35, 0.35, -0.35]
    end = play(env, [command(roll=0.35, pitch=0.35, yaw=-0.35)], still=4)
    check(start, end, turned=vector)
    assert turn(start, end) != pytest.approx(Rotation.from_euler("XYZ", vector).as_rotvec(), abs=RADIANS)


def test_a_later_turn_is_about_the_bases_axes_too(env, start):
    end = play(env, [command(yaw=0.6), command(roll=0.4)], still=4)
    rolled_last = Rotation.from_euler("x", 0.4) * Rotation.from_euler("z", 0.6)
    check(start, end, turned=rolled_last.as_rotvec())


def test_a_step_counts_from_the_last_target_or_from_where_the_lagging_hand_is():
    env = make_env(control_hz=20)
    reached = {}
    for relative_to in ("target", "current"):
        start = env.begin(ASIDE)
        end = play(env, [command(y=0.02)] * 5, still=20, relative_to=relative_to)
        reached[relative_to] = float((end.tcp - start.tcp)[1])
    env.close()
    assert reached["target"] == pytest.approx(0.1, abs=MILLIMETRES)
    assert 0.02 < reached["current"] < 0.09


def test_at_a_target_out_of_reach_the_robot_stays(env, start):
    end = play(env, [command(x=0.6), command(gripper=-1, z=2.0)], still=4)
    check(start, end)
    assert end.opening == pytest.approx(0.0, abs=MILLIMETRES)  # the gripper still obeys


def test_the_next_command_counts_from_the_target_before_the_refused_one(env, start):
    end = play(env, [command(x=0.03), command(x=0.6), command(x=0.02)], still=4)
    check(start, end, move=[0.05, 0, 0])


def test_large_deltas_are_not_clipped(env, start):
    end = play(env, [command(y=0.25, z=0.1, yaw=1.0)], still=8)
    check(start, end, move=[0, 0.25, 0.1], turned=[0, 0, 1.0])


def test_every_scene_starts_with_the_hand_at_the_same_place(env, start):
    play(env, [command(gripper=-1, y=0.2, yaw=0.5)], still=4)
    again = env.begin(ASIDE)
    assert np.array_equal(again.tcp, start.tcp)
    assert again.opening == start.opening
