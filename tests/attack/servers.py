"""Requests to our own model servers."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import cache
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from tests.attack import mutators
from tests.attack.readers import Reader, Rng
from tests.attack.wires import frame_of
from tests.policies.clients.faults import Drifting
from tests.policies.clients.served import STATE
from vlafuzz.policies.clients.openvla import encode
from vlafuzz.policies.serving.serve import serving

_SERVED = ExitStack()


@cache
def _server(protocol: str) -> str:
    """The name of a server of ours that runs until ``stop``."""
    return _SERVED.enter_context(serving(Drifting(), protocol))  # type: ignore[arg-type]


def stop() -> None:
    """End our servers."""
    _SERVED.close()
    _server.cache_clear()


@contextmanager
def _no_thread_dies() -> Iterator[None]:
    crashes: list[str] = []
    hook, threading.excepthook = threading.excepthook, lambda crash: crashes.append(repr(crash.exc_value))
    try:
        yield
    finally:
        threading.excepthook = hook
    assert not crashes, crashes


def requests(rng: Rng, folder: Path) -> None:
    """Mutated requests to a server of ours, which must take the next client as ever."""
    protocol = str(rng.choice(["vla-eval", "openpi", "http"]))
    port = int(_server(protocol).partition("127.0.0.1:")[2].partition("/")[0].partition("?")[0])
    message: Any = {"image": None, "instruction": "go", "prompt": "go", "state": STATE, "observation/state": STATE}
    with _no_thread_dies():
        if protocol == "http":
            _post(rng, port, message)
        else:
            _send(rng, port, protocol, message)


def _post(rng: Rng, port: int, message: Any) -> None:
    body = mutators.data(rng, json.dumps(mutators.tree(rng, json.loads(encode(message)))).encode())
    head = f"POST /act HTTP/1.1\r\nHost: a\r\nContent-Length: {len(body)}\r\n".encode()
    head += b"Vlafuzz-Rollout: {}\r\n\r\n"
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 2) as peer:
        peer.sendall((mutators.data(rng, head) if rng.random() < 0.5 else head) + body)
        peer.settimeout(0.2)
        while peer.recv(1 << 16):  # a reset would be another attack, which prints a traceback
            pass
    with closing(HTTPConnection("127.0.0.1", port, timeout=5)) as line:
        line.request("POST", "/act", encode({"instruction": "go", "state": STATE}))
        assert line.getresponse().status == 200


def _send(rng: Rng, port: int, protocol: str, message: Any) -> None:
    kind = str(rng.choice(["hello", "episode_start", "observation", "episode_end"]))
    payload = {"images": {}, "task_description": "go", "state": STATE, "task": {"name": "go", "seed": 3}}
    numbered = {"type": kind, "payload": payload, "seq": 1, "timestamp": 0.0}
    frame = frame_of(rng, message if protocol == "openpi" else numbered, protocol)
    address = f"ws://127.0.0.1:{port}"
    with suppress(Exception), connect(address, open_timeout=5, close_timeout=0.2) as line:
        if protocol == "openpi":
            line.recv(2)
        line.send(frame)
        line.recv(0.2)
    with connect(address, open_timeout=5, close_timeout=0.2) as line:
        line.ping().wait(5)


SERVERS: dict[str, tuple[Reader, int]] = {"requests to serve": (requests, 1500)}
"""As ``READERS``."""
