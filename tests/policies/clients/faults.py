"""Faulty servers: relays in front of a real one that lose, corrupt and delay its replies."""

import io
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.doubles import Idle
from tests.policies.clients.groot_server import MODALITIES, NAMES, TASK, config, parts, served
from tests.policies.clients.served import websocket
from vlafuzz.policies.base import ActionChunk, Observation, PolicySpec
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, unpack_openpi

GARBAGE = b"\xc1garbage"


class Drifting(Idle):
    """Moves as a function of instruction and proprioception, 20 steps at a time, without memory."""

    spec = PolicySpec("drifting", state=True, execute=None)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self.moves(seen.instruction, seen.state)) for seen in observations]

    def moves(self, instruction: str, state: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng([zlib.crc32(instruction.encode()), zlib.crc32(state.tobytes())])
        moves = rng.uniform(-1, 1, (20, 7)) * [0.03, 0.03, 0.02, 0.1, 0.1, 0.1, 1]
        return moves.astype(np.float32).astype(np.float64)


class Faults:
    """The fault of each reply in order; keeps those that occurred.

    ``drop`` it, ``stall`` for some seconds, send ``garbage`` instead, ``cut`` the connection, or say ``error`` as
    OpenVLA's servers do. Before ``begin`` there are none.
    """

    def __init__(self, plan: Iterable[str | None], seconds: float) -> None:
        self.plan, self.seconds, self.came = iter(plan), seconds, []
        self.over, self._lock, self._begun = threading.Event(), threading.Lock(), False

    def begin(self) -> None:
        self._begun = True

    def next(self) -> str | None:
        with self._lock:
            fault = next(self.plan, None) if self._begun else None
            self.came += [fault] if fault else []
        if fault == "stall":
            self.over.wait(self.seconds)
        return fault


@contextmanager
def relayed(name: str, faults: Faults) -> Iterator[str]:
    """The name of a server of WebSockets behind a relay."""
    protocol, _, address = name.partition(":")
    target, _, query = address.partition("?")

    def session(client: Any) -> None:
        with suppress(OSError, ConnectionClosed), ExitStack() as stack:
            server = stack.enter_context(connect(target, compression=None, max_size=None, close_timeout=1))
            threading.Thread(target=forward, args=(client, server), daemon=True).start()
            for frame in server:
                fault = faults.next()
                if fault == "cut":
                    break
                if fault != "drop":
                    client.send({"garbage": GARBAGE, "error": "error"}.get(fault, frame))

    def forward(client: Any, server: Any) -> None:
        with suppress(OSError, ConnectionClosed):
            for frame in client:
                server.send(frame)
        server.close()

    with websocket(session) as port:
        try:
            yield f"{protocol}:ws://127.0.0.1:{port}?{query}"
        finally:
            faults.over.set()


@contextmanager
def openpi() -> Iterator[str]:
    """The name of a server of openpi's protocol with ``Drifting`` behind it."""

    def session(connection: Any) -> None:
        with suppress(ConnectionClosed):
            connection.send(pack_openpi({}))
            for frame in connection:
                seen = unpack_openpi(frame)
                moves = Drifting().moves(seen["prompt"], seen["observation/state"])
                connection.send(pack_openpi({"actions": moves}))

    with websocket(session) as port:
        yield f"openpi:ws://127.0.0.1:{port}?camera=0&state=1"


@contextmanager
def groot(faults: Faults) -> Iterator[str]:
    """The name of a faulty server of GR00T's protocol with ``Drifting`` behind it."""

    def reply(request: Any) -> Any:
        message = request["data"]["observation"]
        files = [io.BytesIO(message["state"][key]["as_npy"]) for key in NAMES]
        state = np.concatenate([np.load(file)[0, 0] for file in files])
        moves = Drifting().moves(message["language"][TASK][0][0], state).astype(np.float32)
        fault = faults.next()
        replies = {"garbage": GARBAGE, "error": {"error": "error"}}
        # What is cut is never sent either: ZeroMQ hides connections.
        return None if fault in ("drop", "cut") else replies.get(fault, [parts(moves[None]), {}])

    with served(reply, modalities=config(MODALITIES | {"video": [], "state": [*NAMES]})) as (name, _):
        yield f"{name}?camera=0&state=1&state_key={','.join(NAMES)}"
        faults.over.set()
