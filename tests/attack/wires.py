"""Replies of model servers in each protocol, played to our clients in place of a connection."""

import base64
import json
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgpack
import numpy as np

from tests.attack import mutators
from tests.attack.readers import Reader, Rng
from tests.policies.clients import groot_server
from tests.policies.clients.served import black, seen, start
from vlafuzz.policies.clients import groot, openpi, openvla, vla_eval
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, pack_vla_eval
from vlafuzz.rollouts.policies import make_policy

ACTIONS = np.tile([0.01, 0.0, -0.01, 0.0, 0.1, 0.0, 1.0], (3, 1))
HELLO = {
    "protocol_version": 1, "harness_version": "0.8", "model_server": "m", "capabilities": {},
    "observation_params": {"send_state": True, "send_wrist_image": False},
    "action_spec": {"rotation": {"format": "axis_angle"}, "gripper": {"format": "binary_close_01"}},
    "observation_spec": {"state": {"format": "raw"}, "language": {"format": "language"}},
}  # fmt: skip


def array_of(rng: Rng) -> Any:
    """Actions as an array of some type, order and shape."""
    kinds = ["<f8", "<f8", "<f8", "<f4", "<f4", ">f8", "<f2", "<i4", "|b1", "<c16", "<M8[s]", "|S4", "<U3", "<f16"]
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
    packed = _packed(value if rng.random() < 0.3 else mutators.tree(rng, value), style) if rng.random() < 0.9 else b""
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

    def post(self, body: bytes) -> None:
        pass

    def reply(self, wait: float) -> tuple[int, bytes]:
        return 200 if len(self._frames) != 7 else 500, self._frames.popleft()

    def close(self) -> None:
        pass


def _rolled(name: str, module: Any, connection: str, *frames: Any) -> None:
    """A rollout at a server whose frames are played."""
    played = Played(*frames)
    with patch.object(module, connection, lambda *_: played):
        policy: Any = make_policy(name)
        policy.reset([start("one")])
        policy.act([seen("one", images=black(policy.spec))])
        policy.close()


def vla_eval_frames(rng: Rng, folder: Path) -> None:
    hello = {"type": "hello", "payload": HELLO, "seq": 1, "timestamp": 0.0}
    reply = {"type": "action", "payload": {"actions": array_of(rng)}, "seq": 3, "timestamp": 0.0}
    greeted = pack_vla_eval("hello", HELLO, 1)
    first = frame_of(rng, hello, "vla-eval") if rng.random() < 0.4 else greeted
    frames = first, greeted, frame_of(rng, reply, "vla-eval")
    _rolled("vla-eval:ws://127.0.0.1:9?camera=0", vla_eval, "WebSocketConnection", *frames)


def openpi_frames(rng: Rng, folder: Path) -> None:
    query = str(rng.choice(["profile=libero", "camera=0&state=1"]))
    frame: Any = frame_of(rng, {"actions": array_of(rng), "n": np.float32(1)}, "openpi")
    if rng.random() < 0.1:
        frame = mutators.text(rng, "Traceback\nValueError: x")
    frames = pack_openpi({}), pack_openpi({}), frame
    _rolled(f"openpi:ws://127.0.0.1:9?{query}", openpi, "WebSocketConnection", *frames)


def groot_frames(rng: Rng, folder: Path) -> None:
    marks = groot_server.config(groot_server.MODALITIES | {"video": []})
    reply = [groot_server.parts(ACTIONS[None].astype("<f4"), lambda array: array), {}]
    reset, config = msgpack.packb({}), msgpack.packb(marks)
    first = frame_of(rng, marks, "groot") if rng.random() < 0.3 else config
    frames = first, config, reset, frame_of(rng, reply, "groot")
    _rolled("groot:tcp://127.0.0.1:9?camera=0", groot, "ZmqConnection", *frames)


def act_frames(rng: Rng, folder: Path) -> None:
    several = ACTIONS.tolist()
    kinds: list[Any] = [several, {"actions": several}, {"action": several[0]}, {"error": "no"}]
    actions = kinds[int(rng.integers(4))]
    if rng.random() < 0.4:
        raw = base64.b64encode(ACTIONS.tobytes()).decode()
        actions = {"__numpy__": raw, "dtype": "<f8", "shape": [3, 7]}
    body = json.dumps(mutators.tree(rng, actions)).encode()
    body = json.dumps(body.decode()).encode() if rng.random() < 0.2 else body
    body = mutators.data(rng, body) if rng.random() < 0.4 else body
    _rolled("http://127.0.0.1:9/act?camera=0", openvla, "HttpConnection", body)


FRAMES: dict[str, tuple[Reader, int]] = {
    "vla-eval frames": (vla_eval_frames, 2000),
    "openpi frames": (openpi_frames, 2000),
    "GR00T frames": (groot_frames, 2000),
    "/act frames": (act_frames, 2000),
}
"""As ``READERS``."""
