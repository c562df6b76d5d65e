"""Addresses of model servers and their options. Nothing here is connected."""

import sys

import pytest

from vlafuzz.errors import PrerequisiteError, UsageError, install
from vlafuzz.policies.clients.conventions import LAYOUTS
from vlafuzz.policies.clients.options import VlaEvalOptions
from vlafuzz.policies.clients.servers import parse
from vlafuzz.policies.clients.vla_eval import VlaEval
from vlafuzz.rollouts.policies import check_policy_name, known_policies, make_policy


def options(query: str) -> VlaEvalOptions:
    return parse(f"vla-eval:ws://gpu:8000?{query}", VlaEval).options


def test_an_address_is_split_into_name_url_and_options():
    address = parse("vla-eval:wss://gpu.lab:443/models/a?hz=10&camera=320x240", VlaEval)
    assert (address.name, address.url) == (f"vla-eval:{address.url}", "wss://gpu.lab:443/models/a")
    assert (address.options.hz, address.options.camera) == (10, (320, 240))


def test_without_options_the_defaults_hold():
    assert parse("vla-eval:ws://gpu:8000", VlaEval).options == VlaEvalOptions()


@pytest.mark.parametrize(
    ("query", "name", "value"),
    [
        ("camera=128", "camera", (128, 128)),
        ("camera=0", "camera", (0, 0)),
        ("wrist=1", "wrist", True),
        ("state=eef_pos3_quat4_gripper1", "state", "eef_pos3_quat4_gripper1"),
        ("position_scale=0.05", "position_scale", 0.05),
        ("execute=4", "execute", 4),
        ("execute=all", "execute", None),
        ("timeout=0.5", "timeout", 0.5),
        ("deterministic=1", "deterministic", True),
    ],
)
def test_an_option_is_read(query, name, value):
    assert getattr(options(query), name) == value


@pytest.mark.parametrize(
    ("query", "says", "hint"),
    [
        ("camara=128", "unknown option 'camara'", "did you mean 'camera'?"),
        ("zzz=1", "unknown option 'zzz'", "known: action, batch, benchmark, camera"),
        ("gripper=open", "unknown gripper 'open'", "did you mean 'open_01'?"),
        ("rotation=rot6d", "unknown rotation 'rot6d'", "known: axis_angle, euler_xyz, rpy"),
        ("state=joints", "unknown state 'joints'", "known: 0, 1, eef_pos3"),
        ("camera=big", "camera: expected pixels as 224 or 320x240, or 0 for none, got 'big'", None),
        ("hz=7", "hz: expected a divisor of 100, got 7", None),
        ("hz=fast", "hz: input should be a valid integer, got 'fast'", None),
        ("timeout=0", "timeout: input should be greater than 0, got '0'", None),
        ("position_scale=inf", "position_scale: ", None),
        ("execute=0", "execute: input should be greater than or equal to 1, got '0'", None),
        ("hz=5&hz=10", "hz is given twice", "give it once"),
        ("hz", "bad query field: 'hz'", "expected vla-eval:ws://host:port?option=value&…"),
    ],
)
def test_a_wrong_option_is_refused_with_its_value(query, says, hint):
    with pytest.raises(UsageError) as caught:
        options(query)
    assert says in caught.value.message
    assert hint is None or caught.value.hint.startswith(hint)


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


@pytest.mark.parametrize("name", ["vla-eval", "vlaeval:ws://gpu:8000", "vla_eval:ws://gpu:8000"])
def test_a_name_close_to_it_is_pointed_to_it(name):
    with pytest.raises(UsageError, match="unknown policy") as caught:
        check_policy_name(name)
    assert "vla-eval" in caught.value.hint


def test_it_is_listed_with_its_form():
    assert known_policies()["vla-eval:ws://host:port"].startswith("A model behind a vla-eval server")


@pytest.mark.parametrize("missing", ["msgpack", "websockets"])
def test_without_its_packages_it_says_what_to_install(monkeypatch, missing):
    for module in ("websocket_connection", "msgpack_wire", "vla_eval"):
        monkeypatch.delitem(sys.modules, f"vlafuzz.policies.clients.{module}", raising=False)
        monkeypatch.delattr(f"vlafuzz.policies.clients.{module}", raising=False)
    for name in [name for name in sys.modules if name.split(".")[0] == missing]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(PrerequisiteError, match=f"needs the package '{missing}") as caught:
        make_policy("vla-eval:ws://127.0.0.1:9")
    assert caught.value.hint == install("remote")


def test_every_layout_can_be_asked_for():
    annotation = VlaEvalOptions.model_fields["state"].annotation
    assert all(name in str(annotation) for name in LAYOUTS)
