"""Declarations of servers, such as the real ones of vla-eval 0.8.0, become specs."""

import importlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.policies.clients.served import HELLO, STATE
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, Observation, PolicySpec
from vlafuzz.policies.clients.conventions import LAYOUTS, MEASURED, OWN
from vlafuzz.policies.clients.options import VlaEvalOptions
from vlafuzz.policies.clients.vla_eval import DeclaredModel, Hello

RGB, BOTH = "rgb_hwc_uint8", ["third_person", "wrist"]
OTHER = "eef_pos3_quat4_gripper1"
OFT = {"num_images_in_input": 2, "use_proprio": True}
GROOT = {"invert_gripper": False, "_extra_obs_params": {}}


def hello(action: dict = {}, observation: dict = {}, params: dict = {}) -> Hello:  # noqa: B006
    specs = {
        f"{part}_spec": {name: {"name": name, "dims": 0, "format": kind} for name, kind in declared.items()}
        for part, declared in (("action", action), ("observation", observation))
    }
    return Hello.model_validate(HELLO | specs | {"observation_params": params})


def model(greeting: Hello, **options: object) -> DeclaredModel:
    return DeclaredModel("it", greeting, VlaEvalOptions.model_validate(options))


def spec(greeting: Hello, **options: object) -> PolicySpec:
    return model(greeting, **options).spec


class TestSpec:
    @pytest.mark.parametrize(
        ("declared", "rotation", "gripper"),
        [
            ({}, "axis_angle", "open_positive"),
            ({"actions": "raw"}, "axis_angle", "open_positive"),
            ({"rotation": "axis_angle", "gripper": "binary_close_positive"}, "axis_angle", "close_positive"),
            ({"rotation": "euler_xyz", "gripper": "continuous_01"}, "rpy", "open_01"),
            ({"position": "delta_xyz", "gripper": "binary_close_negative"}, "axis_angle", "open_positive"),
            ({"gripper": "binary_close_01"}, "axis_angle", "close_01"),
            ({"gripper": "raw", "rotation": "raw"}, "axis_angle", "open_positive"),
        ],
    )
    def test_actions(self, declared, rotation, gripper):
        action = spec(hello(action=declared)).action
        assert (action.rotation, action.gripper) == (rotation, gripper)
        overridden = spec(hello(action=declared), gripper="close_01", rotation="euler_xyz").action
        assert overridden == ActionSpec(rotation="euler_xyz", gripper="close_01")

    @pytest.mark.parametrize(
        ("declared", "says"),
        [
            ({"position": "absolute_xyz"}, "actions have position 'absolute_xyz'"),
            ({"rotation": "quaternion_xyzw"}, "rotation 'quaternion_xyzw'"),
            ({"gripper": "binary_open_01"}, "gripper 'binary_open_01'"),
            ({"joints": "joint_pos_abs", "gripper": "continuous_01"}, "actions have joints 'joint_pos_abs'"),
        ],
    )
    def test_actions_that_are_not_supported(self, declared, says):
        with pytest.raises(UsageError, match=says) as caught:
            spec(hello(action=declared))
        assert caught.value.hint.startswith("supported: ")

    @pytest.mark.parametrize(
        ("declared", "options", "roles"),
        [
            ({}, {}, BOTH[:1]),
            ({"observation": {"image": RGB, "language": "language"}}, {}, BOTH[:1]),
            ({"observation": {"image": RGB, "wrist_image": RGB}}, {}, BOTH),
            ({"observation": {"image": RGB}, "params": {"send_wrist_image": True}}, {}, BOTH),
            ({"params": {"send_wrist_image": True}}, {"wrist": "0"}, BOTH[:1]),
            ({}, {"wrist": "1"}, BOTH),
            ({"observation": {"state": "raw"}}, {}, []),
            ({"observation": {"state": "raw"}}, {"camera": "128"}, BOTH[:1]),
            ({"observation": {"image": RGB}}, {"camera": "0"}, []),
            ({"observation": {"a": RGB, "b": RGB, "c": RGB}}, {"wrist": "1"}, BOTH),
        ],
    )
    def test_pictures(self, declared, options, roles):
        assert [camera.role for camera in spec(hello(**declared), **options).cameras] == roles

    def test_pictures_have_224_pixels_unless_told_otherwise(self):
        front, wrist = CameraRequest("front", 224, 224), CameraRequest("wrist", 224, 224, "wrist")
        assert spec(hello(), wrist="1").cameras == (front, wrist)
        assert spec(hello(), camera="320x240").cameras == (CameraRequest("front", 320, 240),)

    def test_three_pictures_are_too_many(self):
        with pytest.raises(UsageError, match="wants 3 pictures"):
            spec(hello(observation={"a": RGB, "b": RGB, "c": RGB}))

    @pytest.mark.parametrize(
        ("declared", "option", "layout"),
        [
            ({}, None, None),
            ({}, "1", OWN),
            ({"params": {"send_state": True}}, None, OWN),
            ({"params": {"send_state": True}}, "0", None),
            ({"params": {"send_state": False}}, None, None),
            ({"observation": {"state": "raw"}}, None, OWN),
            ({"observation": {"state": MEASURED}}, None, MEASURED),
            ({"observation": {"state": MEASURED}}, "1", MEASURED),
            ({"observation": {"state": "joint_positions"}}, OTHER, OTHER),
        ],
    )
    def test_proprioception(self, declared, option, layout):
        described = model(hello(**declared), state=option)
        assert described.layout == layout
        assert described.spec.state is (layout is not None)

    def test_proprioception_that_is_not_supported(self):
        with pytest.raises(UsageError, match="declares state 'joint_positions'") as caught:
            spec(hello(observation={"state": "joint_positions"}))
        assert "supported: eef_pos3_axisangle3_gripper1" in caught.value.hint

    def test_poses_of_the_hand_are_refused(self):
        """As X-VLA's: it declares no format of its actions, only that they are absolute."""
        with pytest.raises(UsageError, match="poses of the hand"):
            spec(hello(action={"actions": "raw"}, params={"absolute_action": True}))

    def test_it_says_where_its_conventions_come_from(self):
        told = spec(hello(action={"rotation": "euler_xyz"}), gripper="open_01").provenance
        assert told == {"server": "Scripted", "rotation": "server", "gripper": "option", "state": "none"}
        assert spec(hello()).provenance["gripper"] == "default"

    def test_no_server_is_deterministic_unless_told_so(self):
        assert not spec(hello()).deterministic
        assert spec(hello(), deterministic="1").deterministic


@pytest.mark.parametrize(
    ("module", "name", "weights", "expected"),
    [
        ("openvla", "OpenVLAModelServer", {}, ("axis_angle", "close_positive", 1, None)),
        ("oft", "OFTModelServer", OFT, ("axis_angle", "close_positive", 2, MEASURED)),
        ("groot", "GR00TModelServer", GROOT, ("rpy", "open_01", 1, OWN)),
        ("cogact", "CogACTModelServer", {}, ("axis_angle", "open_positive", 1, None)),
    ],
)
def test_servers_of_known_models_are_understood(module, name, weights, expected):
    server_class = getattr(importlib.import_module(f"vla_eval.model_servers.{module}"), name)
    server = object.__new__(server_class)  # declarations need no weights
    vars(server).update(weights)
    greeting = hello(
        action={part: declared.format for part, declared in server.get_action_spec().items()},
        observation={part: declared.format for part, declared in server.get_observation_spec().items()},
        params=server.get_observation_params(),
    )
    action, cameras = spec(greeting).action, spec(greeting).cameras
    assert (action.rotation, action.gripper, len(cameras), model(greeting).layout) == expected


@pytest.mark.parametrize(
    ("layout", "length", "rest"), [(OWN, 7, [0.5]), (MEASURED, 8, [0.02, -0.02]), (OTHER, 8, [0.5])]
)
def test_layouts_of_proprioception(layout, length, rest):
    sent = LAYOUTS[layout](STATE)
    assert (sent.shape, sent.dtype) == ((length,), np.float32)
    assert sent[:3].tolist() == STATE[:3].tolist()
    assert sent[-len(rest) :] == pytest.approx(rest)
    turn = sent[3 : length - len(rest)]
    rotation = Rotation.from_quat(np.roll(turn, -1)) if len(turn) == 4 else Rotation.from_rotvec(turn)
    assert (rotation * Rotation.from_rotvec(STATE[3:6]).inv()).magnitude() < 1e-6


@pytest.mark.parametrize(
    ("params", "turn"),
    [
        ({}, [-(2 * np.pi - 3.5), 0.0, 0.0]),  # vla-eval's LIBERO turns by less than 180° the other way
        ({"quat_no_antipodal": True}, [3.5, 0.0, 0.0]),  # as robosuite, which goes on beyond 180°
    ],
)
def test_a_model_of_libero_gets_what_vla_evals_own_benchmark_sends(params, turn):
    picture = np.zeros((256, 256, 3), dtype=np.uint8)
    state = np.array([0.1, 0.2, 0.3, 3.5, 0.0, 0.0, 0.5], dtype=np.float32)
    fingers = np.array([0.03, -0.02], dtype=np.float32)
    images = {"front": picture, "wrist": picture + 1}
    seen = Observation("e", 0, "lift it", images=images, state=state, fingers=fingers)
    asked = hello(params={"send_state": True, "send_wrist_image": True} | params)
    message = model(asked, benchmark="libero").message(seen)
    assert list(message["images"]) == ["agentview", "wrist"]
    assert message["images"]["wrist"].max() == 1
    assert message["states"] == pytest.approx([0.1, 0.2, 0.3, *turn, 0.03, -0.02])
    assert message["task_description"] == "lift it"
