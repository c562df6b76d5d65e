"""Addresses of model servers and their options. Nothing here is connected."""

import sys

import pytest

from vlafuzz.errors import PrerequisiteError, UsageError, install
from vlafuzz.policies.clients.options import VlaEvalOptions
from vlafuzz.policies.clients.servers import parse
from vlafuzz.policies.clients.vla_eval import VlaEval
from vlafuzz.rollouts.policies import check_policy_name, make_policy


def options(query: str) -> VlaEvalOptions:
    return parse(f"vla-eval:ws://gpu:8000?{query}", VlaEval).options


def test_an_address_is_split_into_name_url_and_options():
    address = parse("vla-eval:wss://gpu.lab:443/models/a?hz=10&camera=320x240", VlaEval)
    assert (address.name, address.url) == (f"vla-eval:{address.url}", "wss://gpu.lab:443/models/a")
    assert (address.options.hz, address.options.camera) == (10, (320, 240))


@pytest.mark.parametrize(
    ("query", "name", "value"),
    [
        ("camera=128", "camera", (128, 128)),
        ("camera=0", "camera", (0, 0)),
        ("execute=4", "execute", 4),
        ("execute=all", "execute", None),
        ("deterministic=1", "deterministic", True),
    ],
)
def test_an_option_is_read(query, name, value):
    assert getattr(options(query), name) == value


VLA_EVAL, OPENPI, GROOT = "vla-eval:ws://gpu:8000?", "openpi:ws://gpu:8000?", "groot:tcp://gpu:5555?"


@pytest.mark.parametrize(
    ("name", "says", "hint"),
    [
        (VLA_EVAL + "camara=128", "unknown option 'camara'", "did you mean 'camera'?"),
        (VLA_EVAL + "zzz=1", "unknown option 'zzz'", "known: action, batch, benchmark, camera"),
        (VLA_EVAL + "gripper=open", "unknown gripper 'open'", "did you mean 'open_01'?"),
        (VLA_EVAL + "rotation=rot6d", "unknown rotation 'rot6d'", "known: axis_angle, euler_xyz, rpy"),
        (VLA_EVAL + "state=joints", "unknown state 'joints'", "known: 0, 1, eef_pos3"),
        (VLA_EVAL + "camera=big", "camera: expected pixels as 224 or 320x240, or 0 for none, got 'big'", ""),
        (VLA_EVAL + "hz=7", "hz: expected a divisor of 100, got 7", ""),
        (VLA_EVAL + "hz=fast", "hz: input should be a valid integer, ", ""),
        (VLA_EVAL + "timeout=0", "timeout: input should be greater than 0, got '0'", ""),
        (VLA_EVAL + "position_scale=inf", "position_scale: ", ""),
        (VLA_EVAL + "execute=0", "execute: input should be greater than or equal to 1, got '0'", ""),
        (VLA_EVAL + "hz=5&hz=10", "hz is given twice", "give it once"),
        (VLA_EVAL + "hz", "bad query field: 'hz'", "expected vla-eval:ws://host:port?option=value&…"),
        (OPENPI + "profile=librero", "unknown profile 'librero'", "did you mean 'libero'?"),
        (OPENPI + "profile=nowhere.yaml", "nowhere.yaml: cannot be read: no such file", ""),
        (OPENPI + "action=joint_position", "unknown action 'joint_position'", "known: eef_delta"),
        (OPENPI + "state=joint_positions", "unknown state 'joint_positions'", "known: 0, 1, eef_pos3"),
        (OPENPI + "hz=15", "hz: expected a divisor of 100, got 15", ""),
        (OPENPI + "frame=tool", "unknown frame 'tool'", "known: base"),
        (OPENPI + "chunk=10&execute=12", "execute=12 of a chunk of 10", ""),
        (OPENPI + "rotation_scale=0", "rotation_scale: expected a number other than 0, got 0.0", ""),
        (OPENPI + "rotation=euler", "unknown rotation 'euler'", ""),
        (OPENPI + "unnorm_key=bridge_orig", "unknown option 'unnorm_key'", ""),
        (GROOT + "profile=libero&state_key=x,y", "state_key: its parts have 2 numbers, eef_pos3_axis", ""),
        (GROOT + "state_key=x,x", "expected names as x,y,gripper:2, each of them once, got 'x,x'", ""),
        (GROOT + "action_key=x:0", "expected names as x,y,gripper:2", ""),
        (GROOT + "profile=maniskill-panda", "says nothing about groot", ""),
        (GROOT + "api_token=secret", "unknown option 'api_token'", ""),
        ("lerobot:", "'lerobot:' names no folder", ""),
        ("lerobot:x?device=gpu", "device: string should match pattern", ""),
        ("lerobot:x?state_key=proprio", "unknown state_key 'proprio'", ""),
        ("vla-eval", "unknown policy", "expected vla-eval:ws://"),
        ("vlaeval:ws://gpu:8000", "unknown policy", "did you mean 'vla-eval'?"),
        ("vla_eval:ws://gpu:8000", "unknown policy", "did you mean 'vla-eval'?"),
    ],
)
def test_a_wrong_name_is_refused_with_its_value(name, says, hint):
    with pytest.raises(UsageError) as caught:
        check_policy_name(name)
    assert says in caught.value.message
    assert (caught.value.hint or "").startswith(hint)


NONE = ["", "ws://", "ws://gpu", "ws://gpu:0", "ws://gpu:99999", "ws://gpu:a", "http://gpu:8000", "ws://:1"]


@pytest.mark.parametrize("address", NONE)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(UsageError) as caught:
        check_policy_name(f"vla-eval:{address}")
    assert caught.value.hint == "expected vla-eval:ws://host:port?option=value&…"


def test_a_password_is_refused_and_not_repeated():
    with pytest.raises(UsageError, match="the address of 'gpu' has a password") as caught:
        check_policy_name("vla-eval:ws://me:secret@gpu:8000")
    assert "secret" not in str(caught.value)


def test_to_check_a_name_connects_nowhere(monkeypatch):
    monkeypatch.setattr("socket.socket.connect", lambda *_: pytest.fail("connected"))
    check_policy_name("vla-eval:ws://127.0.0.1:9?camera=128")


@pytest.mark.parametrize("missing", ["msgpack", "websockets"])
def test_without_its_packages_it_says_what_to_install(monkeypatch, missing):
    for name in [name for name in sys.modules if name.split(".")[0] == missing]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(PrerequisiteError, match=f"needs the package '{missing}") as caught:
        make_policy("vla-eval:ws://127.0.0.1:9")
    assert caught.value.hint == install("remote")
