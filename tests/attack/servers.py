"""Requests to our own model servers."""

import threading
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from unittest import mock

from websockets.sync.client import connect

from tests.attack.readers import Reader, Rng
from tests.attack.wires import frame_of
from tests.policies.clients.faults import Drifting
from tests.policies.clients.served import STATE
from vlafuzz.policies.serving import serving

_SERVED = ExitStack()


@cache
def _server() -> str:
    """The name of a server of ours that runs until ``stop``."""
    return _SERVED.enter_context(serving(Drifting()))  # type: ignore[arg-type]


def stop() -> None:
    """End our servers."""
    _SERVED.close()
    _server.cache_clear()


def requests(rng: Rng, folder: Path) -> None:
    """Mutated requests to a server of ours, which must take the next client as ever."""
    kind = str(rng.choice(["hello", "episode_start", "observation", "episode_end"]))
    payload = {"images": {}, "task_description": "go", "state": STATE, "task": {"name": "go", "seed": 3}}
    frame = frame_of(rng, {"type": kind, "payload": payload, "seq": 1, "timestamp": 0.0}, "vla-eval")
    address = _server().partition(":")[2].partition("?")[0]
    crashes: list[str] = []
    with mock.patch.object(threading, "excepthook", lambda crash: crashes.append(repr(crash.exc_value))):
        with suppress(Exception), connect(address, open_timeout=5, close_timeout=0.2) as line:
            line.send(frame)
            line.recv(0.2)
        with connect(address, open_timeout=5, close_timeout=0.2) as line:
            line.ping().wait(5)
    assert not crashes, crashes  # of threads


SERVERS: dict[str, tuple[Reader, int]] = {"requests to serve": (requests, 1500)}
"""As ``READERS``."""
