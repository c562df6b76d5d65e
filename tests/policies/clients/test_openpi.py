"""The openpi client: its frames, whole rollouts, and servers that misbehave."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.policies.clients.faults import Drifting, openpi
from tests.policies.clients.served import (
    CLOSE,
    HANG,
    STATE,
    asked,
    check_failure,
    check_same_as_in_process,
    failure,
    websocket,
)
from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Verdict
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, unpack_openpi
from vlafuzz.rollouts.policies import make_policy

GOLDEN = Path(__file__).parent / "golden"  # by openpi-client 0.1.2: scripts/make_frames.py
PICTURE = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
STILL = np.array([[0.0] * 6 + [1.0]])
pytestmark = pytest.mark.usefixtures("opened", "no_pause")


@contextmanager
def scripted(*replies: Any, metadata: Any = None) -> Iterator[tuple[str, list]]:
    """A server with scripted replies to observations; its name, and the requests that it got."""
    left, requests = list(replies), []

    def session(connection: Any) -> None:
        connection.send(pack_openpi({}) if metadata is None else metadata)
        for frame in connection:
            requests.append(unpack_openpi(frame))
            reply = left.pop(0)
            if reply is CLOSE:
                return
            if reply is HANG:
                threading.Event().wait(1.0)
            else:
                connection.send(reply if isinstance(reply, bytes | str) else pack_openpi(reply))

    with websocket(session) as port:
        yield f"openpi:ws://127.0.0.1:{port}", requests


OBSERVATION = {
    "observation/image": PICTURE,
    "observation/wrist_image": PICTURE[::-1],
    "observation/state": np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0, 0.02, -0.02]),
    "prompt": "pick up apple",
}


class TestFrames:
    def test_they_equal_those_of_openpis_own_client_byte_by_byte(self):
        assert pack_openpi(OBSERVATION) == (GOLDEN / "openpi_observation.msgpack").read_bytes()

    def test_those_of_openpis_own_packer_are_read(self):
        message = unpack_openpi((GOLDEN / "openpi_observation.msgpack").read_bytes())
        assert message.keys() == OBSERVATION.keys()
        assert np.array_equal(message["observation/image"], PICTURE)
        reply = unpack_openpi((GOLDEN / "openpi_reply.msgpack").read_bytes())
        assert np.array_equal(reply["actions"], np.linspace(-1, 1, 14).reshape(2, 7).astype(np.float32))
        assert reply["server_timing"] == {"infer_ms": 1.5, "prev_total_ms": 2.5}
        assert reply["policy_timing"]["infer_ms"].dtype == np.float32


def request(query: str) -> dict:
    """The request with an observation."""
    with scripted({"actions": STILL}) as (name, requests):
        asked(name + query)
    return requests[0]


def test_an_observation_has_the_models_keys():
    message = request("?camera=48x32&wrist=1&state=eef_pos3_axisangle3_gripper2")
    assert list(message) == list(OBSERVATION)
    assert message["observation/image"].shape == (32, 48, 3)
    assert message["observation/state"][:6].tolist() == STATE[:6].tolist()
    assert message["prompt"] == "pick up apple"
    other = request("?camera=32&image_key=cam&instruction_key=task")
    assert list(other) == ["cam", "task"]


def test_whole_rollouts_are_those_in_process_action_for_action():
    with openpi() as name:
        check_same_as_in_process(name, Drifting, Verdict.FAILED)


class TestWrongAnswers:
    @pytest.mark.parametrize(
        ("reply", "cause", "says"),
        [
            ("Traceback:\n  File x\nKeyError: 'prompt'\n", "remote", ": KeyError: 'prompt'$"),
            (b"\xc1garbage", "protocol", "not an openpi message: 8 bytes"),
            (b"\x01", "protocol", "no dictionary, but 1"),
            ({"action": STILL}, "bad_action", r"without actions, but \['action'\]"),
            ({"actions": np.zeros((10, 32))}, "bad_action", r"actions of shape \(10, 32\)"),
            ({"actions": STILL, "x": bytes(5 << 20)}, "protocol", "more than 4 MiB"),
            ({"actions": {b"__ndarray__": True, b"data": b"1"}}, "protocol", "KeyError"),
            (CLOSE, "connect", "the connection broke"),
        ],
    )  # fmt: skip
    def test_are_errors_with_their_cause(self, reply, cause, says):
        with scripted(reply) as (name, _):
            check_failure(failure(f"{name}?camera=0"), cause, says)

    def test_a_key_that_the_model_misses_is_named_with_what_was_sent(self):
        missing = "Traceback (most recent call last):\n  File x, in __call__\nKeyError: 'observation/state'\n"
        with scripted(missing) as (name, _):
            error = failure(name)
        said = ": KeyError: 'observation/state', which was not sent; sent were observation/image, prompt"
        assert error.message.endswith(said)
        assert error.hint.startswith("name a profile, or the model's own keys: ")

    def test_a_chunk_of_another_length_than_the_options_say(self):
        with scripted({"actions": np.zeros((16, 7))}) as (name, _):
            error = failure(f"{name}?camera=0&chunk=10")
        assert error.message.endswith("a chunk of 16 actions, expected chunk=10")


def test_a_server_that_greets_with_an_error_is_none():
    greeted = scripted(metadata="ImportError: no jax")
    with greeted as (name, _), pytest.raises(PrerequisiteError, match=r": ImportError: no jax$"):
        make_policy(name)
