"""Layouts of the state of a hand that points down, and moves as a policy writes them."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from vlafuzz.policies.base import ActionSpec
from vlafuzz.policies.clients.conventions import LAYOUTS, OWN, ROTATIONS
from vlafuzz.policies.harness import metric, written_as

angles = st.tuples(*[st.floats(-1.4, 1.4)] * 3)
DOWN = [Rotation.from_euler("x", angle) * Rotation.from_euler("z", 0.3) for angle in (3.13, -3.13)]


@pytest.mark.parametrize(("rotation", "axes"), [("rpy", "xyz"), ("euler_xyz", "XYZ")])
@given(angles=angles)
def test_angles_are_turns_about_fixed_or_moving_axes(rotation, axes, angles):
    spec = ActionSpec(rotation=rotation, position_scale=0.05, rotation_scale=0.5)
    move = metric(np.array([1.0, 0, 0, *angles, -1.0]), spec)
    turn = Rotation.from_euler(axes, 0.5 * np.array(angles))
    assert move == pytest.approx([0.05, 0, 0, *turn.as_rotvec(), -1])


@pytest.mark.parametrize("rotation", ROTATIONS)
@given(angles=angles)
def test_what_is_written_is_read_as_the_same_move(rotation, angles):
    spec = ActionSpec(rotation=rotation, position_scale=0.05, rotation_scale=-0.5)
    move = np.array([0.01, -0.02, 0.03, *Rotation.from_euler("xyz", angles).as_rotvec(), -1.0])
    assert metric(written_as(move, spec), spec) == pytest.approx(move, abs=1e-6)


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name != OWN])
def test_states_of_a_hand_that_points_down_do_not_jump(layout):
    states = [np.hstack([[0.1, -0.2, 0.3], turn.as_rotvec(), 1.0]).astype(np.float32) for turn in DOWN]
    one, other = map(LAYOUTS[layout], states)
    assert one == pytest.approx(other, abs=0.03)
