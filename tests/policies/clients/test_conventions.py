"""Conventions of actions against SciPy's rotations: the move is the same in all of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vlafuzz.policies.clients.conventions import LAYOUTS, OWN, ROTATIONS, SCALED, Convention

WRITTEN = {
    "axis_angle": lambda turn: turn.as_rotvec(),
    "rpy": lambda turn: turn.as_euler("xyz"),
    "euler_xyz": lambda turn: turn.as_euler("XYZ"),
    "quaternion_xyzw": lambda turn: -3 * turn.as_quat(),  # of any length, and either sign
    "quaternion_wxyz": lambda turn: turn.as_quat(scalar_first=True),
    "rot6d": lambda turn: turn.as_matrix()[:, :2].T.reshape(-1),
    "rot6d_interleaved": lambda turn: turn.as_matrix()[:, :2].reshape(-1),
}
HAND = np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0])
angles = st.tuples(*[st.floats(-1.4, 1.4)] * 3)


def moved(convention: Convention, shift: list[float], turn: Rotation) -> tuple[np.ndarray, Rotation]:
    """The hand's pose after one action in free space."""
    action = np.hstack([shift, WRITTEN[convention.rotation](turn), 1.0])
    move = convention.moves(action[None], HAND)[0]
    assert move[6] == 1.0
    return HAND[:3] + move[:3], Rotation.from_rotvec(move[3:6]) * Rotation.from_rotvec(HAND[3:])


def close(a: Rotation, b: Rotation) -> bool:
    return (a * b.inv()).magnitude() < 1e-6


@pytest.mark.parametrize("rotation", ROTATIONS)
class TestMoves:
    @given(angles=angles)
    def test_a_move_in_the_bases_frame(self, rotation, angles):
        turn = Rotation.from_euler("xyz", angles)
        at, facing = moved(Convention(False, False, rotation, 0.5, 1.0), [0.2, 0, 0], turn)
        assert at == pytest.approx([0.2, -0.2, 0.3])
        assert close(facing, turn * Rotation.from_rotvec(HAND[3:]))

    @given(angles=angles)
    def test_a_move_in_the_hands_frame(self, rotation, angles):
        turn, now = Rotation.from_euler("xyz", angles), Rotation.from_rotvec(HAND[3:])
        at, facing = moved(Convention(False, True, rotation, 1.0, 1.0), [0, 0, 0.1], turn)
        assert at == pytest.approx(HAND[:3] + 0.1 * now.as_matrix()[:, 2])
        assert close(facing, now * turn)

    @given(angles=angles)
    def test_a_pose(self, rotation, angles):
        turn = Rotation.from_euler("xyz", angles)
        at, facing = moved(Convention(True, False, rotation, 1.0, 1.0), [0.4, 0.5, 0.6], turn)
        assert at == pytest.approx([0.4, 0.5, 0.6])
        assert close(facing, turn)

    def test_of_another_width_is_refused(self, rotation):
        with pytest.raises(ValueError, match=r"actions of shape \(1, 11\), expected \(steps, "):
            Convention(True, False, rotation, 1.0, 1.0).moves(np.zeros((1, 11)), HAND)


def test_three_numbers_are_scaled_to_radians():
    moves = Convention(False, True, "rpy", 0.05, 0.5).moves(np.array([[1.0, 0, 0, 0, 0, 1, -1]]), np.zeros(6))
    assert moves[0] == pytest.approx([0.05, 0, 0, 0, 0, 0.5, -1])


@pytest.mark.parametrize("rotation", ["quaternion_xyzw", "rot6d"])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_numbers_that_are_no_rotation_are_refused(rotation, value):
    width = 4 + len(ROTATIONS[rotation].names)
    with pytest.raises(ValueError, match=r"not finite|zero norm|no rotation"):
        Convention(True, False, rotation, 1.0, 1.0).moves(np.full((1, width), value), HAND)


@pytest.mark.parametrize("rotation", ROTATIONS)
@pytest.mark.parametrize(("pose", "tool"), [(False, False), (False, True), (True, False)])
@given(angles=angles)
def test_what_is_written_is_read_as_the_same_move(rotation, pose, tool, angles):
    scale = 0.5 if rotation in SCALED else 1.0
    convention = Convention(pose, tool, rotation, 0.05, scale)
    turn = Rotation.from_euler("xyz", angles).as_rotvec()
    moves = np.array([[0.01, -0.02, 0.03, *turn, -1.0], [0.0, 0.1, 0.0, 0.0, 0.0, 0.2, 1.0]])
    assert convention.moves(convention.written(moves, HAND), HAND) == pytest.approx(moves, abs=1e-6)


DOWN = [Rotation.from_euler("x", angle) * Rotation.from_euler("z", 0.3) for angle in (3.13, -3.13)]


@pytest.mark.parametrize("rotation", ROTATIONS)
def test_poses_of_a_hand_that_points_down_do_not_jump(rotation):
    pose = Convention(True, False, rotation, 1.0, 1.0)
    still = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    one, other = (pose.written(still, np.hstack([HAND[:3], turn.as_rotvec()])) for turn in DOWN)
    assert one == pytest.approx(other, abs=0.03)


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name != OWN])
def test_neither_do_states(layout):
    states = [np.hstack([HAND[:3], turn.as_rotvec(), 1.0]).astype(np.float32) for turn in DOWN]
    one, other = map(LAYOUTS[layout], states)
    assert one == pytest.approx(other, abs=0.03)
