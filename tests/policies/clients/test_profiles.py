"""Profiles of known models: their options, what overrides them, and what is refused."""

import re

import pytest

from tests.documentation import text
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest
from vlafuzz.policies.clients.groot import GrootOptions
from vlafuzz.policies.clients.lerobot import LeRobotOptions
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.openpi import OpenPi, OpenPiOptions
from vlafuzz.policies.clients.openvla import ActOptions, OpenVla
from vlafuzz.policies.clients.options import ProfiledOptions, VlaEvalOptions, known_profiles
from vlafuzz.policies.clients.servers import client, parse
from vlafuzz.policies.clients.vla_eval import DeclaredModel, Hello, VlaEval
from vlafuzz.rollouts.policies import check_policy_name

PAGE = text("docs/servers.md")
ROBOSUITE = ActionSpec(relative_to="current", position_scale=0.05, rotation_scale=0.5, gripper="close_positive", hz=20)
EXECUTABLE = [
    (name, protocol)
    for name, profile in known_profiles().items()
    for protocol in profile.protocols
    if protocol != "vla-eval"  # whose servers declare the rest themselves
]


def openpi(query: str) -> ProfiledOptions:
    return parse(f"openpi:ws://gpu:8000?{query}", OpenPi).options


def act(query: str) -> ProfiledOptions:
    return parse(f"http://gpu:8000/act?{query}", OpenVla).options


class TestKnown:
    @pytest.mark.parametrize(("name", "protocol"), EXECUTABLE)
    def test_each_is_a_spec_for_each_of_its_protocols(self, name, protocol):
        kind = client(protocol)
        address = parse(kind.form.replace("host:port", "gpu:1") + f"?profile={name}", kind)
        spec = Model(address.name, address.options).spec
        assert spec.provenance["profile"] == name
        side = 256 if protocol == "groot" else 224
        assert spec.cameras[0] == CameraRequest("front", side, side)

    def test_libero_behind_openpi(self):
        spec = Model("it", openpi("profile=libero")).spec
        assert spec.action == ROBOSUITE
        assert [camera.role for camera in spec.cameras] == ["third_person", "wrist"]
        assert (spec.state, spec.execute) == (True, 5)

    @pytest.mark.parametrize(("asked", "pictures"), [(True, 2), (False, 1)])
    def test_libero_behind_vla_eval_sends_what_its_servers_ask_for(self, asked, pictures):
        options = parse("vla-eval:ws://gpu:8000?profile=libero&execute=5", VlaEval).options
        declared = {
            "action_spec": {"rotation": {"format": "euler_xyz"}},
            "observation_spec": {"image": {"format": "rgb_hwc_uint8"}, "state": {"format": "raw"}},
            "observation_params": {"send_wrist_image": asked, "send_state": asked},
            "protocol_version": 1,
        }
        spec = DeclaredModel("it", Hello.model_validate(declared), options).spec
        assert spec.action == ROBOSUITE
        assert [camera.width for camera in spec.cameras] == [256] * pictures
        assert (spec.state, spec.execute, spec.provenance["profile"]) == (asked, 5, "libero")

    def test_bridge(self):
        options = act("profile=bridge")
        assert Model("it", options).spec.action == ActionSpec(rotation="rpy", gripper="open_01")
        assert options.unnorm_key == "bridge_orig"


class TestOwn:
    def test_an_option_wins_over_the_profile(self):
        options = openpi("profile=libero&execute=10&gripper=open_positive&camera=128")
        assert (options.execute, options.gripper, options.camera) == (10, "open_positive", (128, 128))
        assert options.rotation_scale == 0.5

    def test_a_file_of_ones_own(self, tmp_path):
        path = tmp_path / "mine.yaml"
        path.write_text("about: a\nsource: b\noptions: {hz: 10}\nprotocols: {openpi: {image_key: cam}}\n")
        options = openpi(f"profile={path}")
        assert (options.hz, options.image_key) == (10, "cam")

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("about: [", "not YAML: while parsing"),
            ("- a", "mine.yaml: input should be"),
            ("about: a\nsource: b\noptions: {}\nprotocols: {http: {}}", "says nothing about openpi"),
            ("about: a\nsource: b\noptions: {camara: 1}\nprotocols: {openpi: {}}", "unknown option 'camara'"),
            ("about: a\nsource: b\noptions: {state: 7}\nprotocols: {openpi: {}}", "unknown state 7"),
            ("!!python/object/apply:os.getcwd []", "not YAML: could not determine a constructor"),
        ],
    )
    def test_a_file_that_is_none_is_refused_with_what_is_wrong(self, tmp_path, text, says):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        with pytest.raises(UsageError, match=re.escape(says)) as caught:
            openpi(f"profile={path}")
        assert caught.value.hint


def test_joints_are_refused_of_a_model_that_declares_itself_too(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("about: a\nsource: b\noptions: {action: joint_delta}\nprotocols: {vla-eval: {}}\n")
    with pytest.raises(UsageError, match="unknown action 'joint_delta'"):
        check_policy_name(f"vla-eval:ws://gpu:8000?profile={path}")


OPTIONS = (ActOptions, GrootOptions, LeRobotOptions, OpenPiOptions, VlaEvalOptions)


@pytest.mark.parametrize("option", sorted(set().union(*(kind.model_fields for kind in OPTIONS))))
def test_the_page_on_servers_has_a_row_for_every_option(option):
    assert re.search(rf"^\| .*`{option}`", PAGE, flags=re.MULTILINE)
