"""The page on cameras and wires has the numbers of the code, and its sample server answers."""

import math
import threading

import numpy as np
import pytest
import zmq
from scipy.spatial.transform import Rotation

from tests.documentation import text
from tests.policies.clients.served import asked, black, seen
from vlafuzz.policies.clients.conventions import OWN
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.openpi import OpenPi
from vlafuzz.policies.clients.openvla import OpenVla
from vlafuzz.policies.clients.options import ProfiledOptions, known_profiles, profile_options
from vlafuzz.policies.clients.servers import parse
from vlafuzz.rollouts.policies import client
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import GOOGLE, PANDA, WIDOWX, Rig
from vlafuzz.worlds.tabletop.room import WRIST_CAMERA

PAGE = text("docs/wires.md")
HEIGHTS = {"panda": 224, "widowx": 480, "google": 512}


def camera(name: str, size: tuple[int, int], fov: float, aspect: float, position, axes: np.ndarray) -> str:
    """A row; ``axes``: rows forward, left and up."""
    (width, height), (forward, left, up) = size, axes
    fy = height / 2 / math.tan(math.radians(fov) / 2)
    fx = fy * width / height / aspect
    place = ", ".join(f"{value + 0.0:.3f}" for value in np.round(position, 3))
    turn = Rotation.from_matrix(np.stack([-left, -up, forward], axis=1)).as_quat(scalar_first=True)
    numbers = ", ".join(f"{value:.4f}" for value in turn)
    middle = f"{width / 2:g}, {height / 2:g}"
    return f"| {name} | {width} × {height} | {fov:g}° | {fx:.1f}, {fy:.1f} | {middle} | {place} | {numbers} |"


def third_person(rig: Rig) -> str:
    pose, height = camera_pose(rig.view), HEIGHTS[rig.robot]
    position = pose.position - np.array(rig.base)
    size = rig.view.width(height), height
    return camera(f"`{rig.robot}`", size, rig.view.fov, rig.view.aspect, position, pose.axes)


def wrist() -> str:
    position, (w, x, y, z) = WRIST_CAMERA
    axes = Rotation.from_quat([x, y, z, w]).as_matrix().T
    return camera("`panda`, wrist", (224, 224), 90, 1, position, axes)


def profile(name: str, protocol: str) -> str:
    options = client(protocol).options.model_validate(profile_options(name, protocol))
    keys = [options.image_key, *[options.wrist_key] * bool(options.wrist)]
    pictures = f"{', '.join(f'`{key}`' for key in keys)} of {options.camera[0]}"
    state = f"`{options.layout}`" if options.layout else "none"
    units = f"{options.position_scale:g}, {options.rotation_scale:g}"
    gripper = options.gripper or "open_positive"
    conventions = f"{units} | `{options.rotation}` | `{gripper}` | {options.hz}"
    return f"| {name}, {protocol} | {pictures} | {state} | {conventions} |"


ROWS = [*map(third_person, (PANDA, WIDOWX, GOOGLE)), wrist()]
PROFILES = [
    profile(name, protocol)
    for name, known in known_profiles().items()
    for protocol in known.protocols
    if protocol not in ("vla-eval", "lerobot")  # which declare theirs
]


@pytest.mark.parametrize("row", [*ROWS, *PROFILES])
def test_every_camera_and_every_profile_has_its_row(row):
    assert row in PAGE.splitlines()


@pytest.mark.parametrize(("kind", "form"), [(OpenPi, "openpi:ws://gpu:1"), (OpenVla, "http://gpu:1/act")])
def test_the_keys_of_a_request_are_those_of_its_row(kind, form):
    options: ProfiledOptions = parse(f"{form}?wrist=1&state=1&camera=32x16", kind).options
    model = Model("it", options)
    message = model.message(seen("one", images=black(model.spec)))
    (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| {options.protocol} | ")]
    assert all(f"`{key}`" in row for key in message), message.keys()
    assert (message[options.image_key].shape, message[options.image_key].dtype) == ((16, 32, 3), np.uint8)
    assert (message[options.state_key].dtype, options.layout) == (np.float32, OWN)


def test_the_sample_server_of_groot_answers_a_request():
    example = {"__name__": "groot"}
    exec(text("docs/samples/groot.py"), example)
    over = threading.Event()
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        port = socket.bind_to_random_port("tcp://127.0.0.1")

        def serve() -> None:
            while not over.is_set():
                if socket.poll(20):
                    example["serve"](socket)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            actions = asked(f"groot:tcp://127.0.0.1:{port}")
        finally:
            over.set()
            thread.join()
    assert actions == [[pytest.approx(0.01)] * 7]
