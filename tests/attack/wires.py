"""Replies of model servers in each protocol, played to our clients in place of a connection."""

import base64
import json
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from tests.attack import mutators
from tests.attack.readers import Reader, Rng
from tests.policies.clients import groot_server
from tests.policies.clients.served import black, seen, start
from vlafuzz.policies.clients import msgpack_wire
from vlafuzz.policies.clients.groot import Groot
from vlafuzz.policies.clients.msgpack_wire import pack_groot, pack_openpi, pack_vla_eval
from vlafuzz.policies.clients.openpi import OpenPi
from vlafuzz.policies.clients.openvla import ActSession, OpenVla
from vlafuzz.policies.clients.profiled import Model
from vlafuzz.policies.clients.remote import parse
from vlafuzz.policies.clients.vla_eval import Messages, VlaEval
from vlafuzz.policies.clients.vla_eval_spec import spec_of

ACTIONS = np.tile([0.01, 0.0, -0.01, 0.0, 0.1, 0.0, 1.0], (3, 1))
HELLO = {
    "protocol_version": 1, "harness_version": "0.8", "model_server": "m", "capabilities": {},
    "observation_params": {"send_state": True, "send_wrist_image": False},
    "action_spec": {"rotation": {"format": "axis_angle"}, "gripper": {"format": "binary_close_01"}},
    "observation_spec": {"state": {"format": "raw"}, "language": {"format": "language"}},
}  # fmt: skip


def array_of(rng: Rng) -> Any:
    """Actions as an array of some type, order and shape."""
    kinds = [
        "<f8",
        "<f8",
        "<f8",
        "<f4",
        "<f4",
        ">f8",
        "<f2",
        "<i4",
        "|b1",
        "<c16",
        "<M8[s]",
        "|S4",
        "<U3",
        "<f16",
    ]
    with np.errstate(all="ignore"):
        array = ACTIONS.astype(str(rng.choice(kinds)))
    if array.dtype.kind == "f" and rng.random() < 0.2:
        array[0, 0] = rng.choice([np.nan, np.inf, 60000.0])
    return array if rng.random() < 0.8 else array.reshape(rng.permutation([3, 7, 1]))


def _packed(value: Any, style: str) -> bytes:
    """In msgpack, with arrays in one of the styles; what msgpack does not take as text."""

    def default(array: Any) -> Any:
        if not isinstance(array, np.ndarray):
            return str(array)[:400]
        data, kind, shape = array.tobytes(), array.dtype.str, list(array.shape)
        if style == "openpi":
            return {b"__ndarray__": True, b"data": data, b"dtype": kind, b"shape": shape}
        if style == "groot":
            return groot_server.npy(array) if array.flags.c_contiguous else groot_server.nd(array)
        return {"__ndarray__": True, "data": data, "dtype": kind, "shape": shape}

    return bytes(msgpack.packb(value, default=default, unicode_errors="surrogatepass"))


def _frame(rng: Rng, value: Any, style: str) -> bytes:
    """A mutated frame: the value, its encoded arrays, or the bytes."""
    packed = (
        _packed(value if rng.random() < 0.3 else mutators.tree(rng, value), style)
        if rng.random() < 0.9
        else b""
    )
    if rng.random() < 0.4:
        raw = msgpack.unpackb(packed, strict_map_key=False) if packed else None
        with suppress(OverflowError, ValueError, TypeError):
            packed = _packed(mutators.tree(rng, raw), style)
    return mutators.data(rng, packed) if rng.random() < 0.3 else packed


def frame_of(rng: Rng, value: Any, style: str) -> bytes:
    while True:
        with suppress(OverflowError, ValueError, TypeError, RecursionError):  # msgpack takes no such value
            return _frame(rng, value, style)


class Played:
    """A connection whose frames are played."""

    url = "ws://played"

    def __init__(self, *frames: Any) -> None:
        self._frames = deque(frames)

    def send(self, frame: bytes) -> None:
        pass

    def receive(self, wait: float | None = None) -> Any:
        return self._frames.popleft()

    def ask(self, frame: bytes) -> Any:
        return self._frames.popleft()

    def post(self, body: bytes, headers: Any) -> None:
        pass

    def reply(self, wait: float) -> tuple[int, bytes]:
        return 200 if len(self._frames) != 7 else 500, self._frames.popleft()

    def close(self) -> None:
        pass


def _rolled(policy: Any) -> None:
    policy.reset([start("one")])
    policy.act([seen("one")])
    policy.close()


def _wired(kind: Any, name: str, connection: Played) -> Any:
    """A policy whose connection is played."""
    policy = object.__new__(kind)
    address = parse(name, kind)
    policy._name, policy._url, policy._timeout, policy._live, policy._kept = (
        address.name,
        address.url,
        5.0,
        {},
        {},
    )
    policy._msgpack, policy._connect, policy._options = msgpack_wire, lambda *_: connection, address.options
    if kind is not VlaEval:
        policy._model = Model(address.name, address.options)
        policy.spec = policy._model.spec
    return policy


def vla_eval_frames(rng: Rng, folder: Path) -> None:
    hello = {"type": "hello", "payload": HELLO, "seq": 1, "timestamp": 0.0}
    reply = {"type": "action", "payload": {"actions": array_of(rng)}, "seq": 3, "timestamp": 0.0}
    first = frame_of(rng, hello, "vla-eval") if rng.random() < 0.4 else pack_vla_eval("hello", HELLO, 1)
    greeted = pack_vla_eval("hello", HELLO, 1)
    policy = _wired(
        VlaEval,
        "vla-eval:ws://127.0.0.1:9?camera=0",
        Played(first, greeted, frame_of(rng, reply, "vla-eval")),
    )
    _, declared = policy._open()
    policy.spec = spec_of(policy._name, declared, policy._options)
    policy._messages = Messages(policy._name, declared, policy._options)
    if declared.model_server == "m":
        _rolled(policy)


def openpi_frames(rng: Rng, folder: Path) -> None:
    name = str(
        rng.choice(
            [
                "profile=libero",
                "camera=0&state=1",
                "camera=0&rotation=quaternion_xyzw&action=eef_pose&execute=1",
            ]
        )
    )
    frames = [pack_openpi({}), frame_of(rng, {"actions": array_of(rng), "n": np.float32(1)}, "openpi")]
    frames = [
        mutators.text(rng, "Traceback\nValueError: x") if rng.random() < 0.1 else frame for frame in frames
    ]
    policy = _wired(OpenPi, f"openpi:ws://127.0.0.1:9?{name}", Played(*frames))
    policy.reset([start("one")])
    policy.act([seen("one", images=black(policy.spec))])


def groot_frames(rng: Rng, folder: Path) -> None:
    marks = groot_server.config(groot_server.MODALITIES | {"video": []})
    reply = [groot_server.parts(ACTIONS[None].astype("<f4"), lambda array: array), {}]
    reset, config = msgpack.packb({}), msgpack.packb(marks)
    first = frame_of(rng, marks, "groot") if rng.random() < 0.3 else config
    played = Played(first, config, reset, frame_of(rng, reply, "groot"))
    policy: Any = object.__new__(Groot)
    address = parse("groot:tcp://127.0.0.1:9?camera=0", Groot)
    policy._address, policy._options, policy._msgpack = address, address.options, msgpack_wire
    policy._connection, policy._connect = played, lambda *_: played
    policy._model = Model(address.name, address.options)
    policy.spec = policy._model.spec
    policy._modalities = policy._get_modalities()
    _rolled(policy)
    pack_groot({})


def act_frames(rng: Rng, folder: Path) -> None:
    actions: Any = [
        ACTIONS.tolist(),
        {"actions": ACTIONS.tolist()},
        {"action": ACTIONS[0].tolist()},
        {"error": "no"},
    ][int(rng.integers(4))]
    if rng.random() < 0.4:
        raw = base64.b64encode(ACTIONS.tobytes()).decode()
        actions = {"__numpy__": raw, "dtype": "<f8", "shape": [3, 7]}
    body = json.dumps(mutators.tree(rng, actions)).encode()
    body = json.dumps(body.decode()).encode() if rng.random() < 0.2 else body
    body = mutators.data(rng, body) if rng.random() < 0.4 else body
    policy = _wired(OpenVla, "http://127.0.0.1:9/act?camera=0", Played(body))
    policy._begin = lambda begun: ActSession(Played(body), policy._model, policy._options, begun)
    _rolled(policy)


FRAMES: dict[str, tuple[Reader, int]] = {
    "vla-eval frames": (vla_eval_frames, 2000),
    "openpi frames": (openpi_frames, 2000),
    "GR00T frames": (groot_frames, 2000),
    "/act frames": (act_frames, 2000),
}
"""As ``READERS``."""
