"""The rig's geometry, without a simulator."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from vlafuzz.errors import SceneError
from vlafuzz.model import Camera
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA, RIGS, rig

NOT_MOVED = Camera()
NOMINAL = camera_pose(PANDA.view)
TURN = st.floats(-5, 5)
OFFSET = st.floats(0, 0.05), st.floats(-180, 180), st.floats(-90, 90)  # distance, azimuth, elevation
CAMERAS = st.builds(Camera, *OFFSET, roll=TURN, pitch=TURN, yaw=TURN)
SPOTS = st.tuples(st.floats(*PANDA.workspace.x), st.floats(*PANDA.workspace.y), st.floats(0, 0.2))
CENTRE = np.array([[-0.04, 0.0, 0.02]])
AHEAD, LEFT, UP = np.eye(3) * 0.1  # of the robot


def seen(point, camera: Camera = NOT_MOVED) -> np.ndarray:
    return camera_pose(PANDA.view, camera).project(np.atleast_2d(np.asarray(point, dtype=float)))[0][0]


@given(CAMERAS, SPOTS)
def test_back_projection_undoes_projection(camera: Camera, spot):
    pose = camera_pose(PANDA.view, camera)
    uv, depth = pose.project(np.array([spot]))
    assert depth[0] > 0
    assert pose.back_project(uv, spot[2])[0] == pytest.approx(spot, abs=1e-6)


@pytest.mark.parametrize("x", PANDA.workspace.x)
@pytest.mark.parametrize("y", PANDA.workspace.y)
def test_the_nominal_camera_sees_the_whole_workspace(x, y):
    uv = seen([x, y, 0.0])
    assert ((uv > 0.01) & (uv < 0.99)).all()


def test_it_faces_the_robot_so_that_the_robots_left_is_right_and_near_is_up():
    middle = seen(CENTRE)
    assert seen(CENTRE + LEFT)[0] > middle[0] + 0.05
    assert seen(CENTRE - AHEAD)[1] < middle[1] - 0.02
    assert seen(CENTRE + UP)[1] < middle[1] - 0.05


def test_the_quaternion_is_of_the_same_frame():
    pose = camera_pose(PANDA.view, Camera(0.05, 40, 30, roll=3, pitch=-4, yaw=5))
    w, x, y, z = pose.quaternion
    assert pytest.approx(pose.axes) == Rotation.from_quat([x, y, z, w]).as_matrix().T


@pytest.mark.parametrize(
    ("camera", "shift"),
    [
        (Camera(yaw=5), (1, 0)),  # it turns left, the picture goes right
        (Camera(yaw=-5), (-1, 0)),
        (Camera(pitch=5), (0, -1)),  # it turns down, the picture goes up
        (Camera(pitch=-5), (0, 1)),
        (Camera(distance=0.05, azimuth=90), (-1, 0)),
        (Camera(distance=0.05, elevation=90), (0, 1)),
    ],
)
def test_a_deviation_shifts_the_picture_the_right_way(camera, shift):
    moved = seen(CENTRE, camera) - seen(CENTRE)
    assert np.sign(np.where(np.abs(moved) < 0.005, 0, moved)).tolist() == list(shift)


def test_a_turn_shifts_the_middle_by_its_tangent():
    expected = np.tan(np.radians(5)) / (2 * np.tan(np.radians(PANDA.view.fov) / 2))
    assert seen(PANDA.view.target, Camera(yaw=5))[0] - 0.5 == pytest.approx(expected)


def test_the_camera_stands_where_its_offset_says():
    moved = camera_pose(PANDA.view, Camera(0.05, 90, 0, roll=3, yaw=2))
    assert moved.position - NOMINAL.position == pytest.approx([0, 0.05, 0])


def test_a_robot_that_is_not_there_is_refused_with_what_is():
    assert rig("panda") is RIGS["panda"]
    with pytest.raises(SceneError, match="robot: unknown robot 'pandas'") as caught:
        rig("pandas")
    assert caught.value.hint == "did you mean 'panda'?"
