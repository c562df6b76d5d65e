"""Servers that misbehave on real sockets, and requests to our own servers."""

import json
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import cache
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

from websockets.http11 import Request
from websockets.server import ServerProtocol
from websockets.sync.client import connect

from tests.attack import mutators
from tests.attack.readers import Reader, Rng
from tests.attack.wires import ACTIONS, array_of, frame_of
from tests.policies.clients.faults import Drifting
from tests.policies.clients.served import STATE, seen, start
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.openvla import encode
from vlafuzz.policies.serving.serve import serving
from vlafuzz.rollouts.policies import make_policy


@contextmanager
def chaotic(rng: Rng, answers: list[bytes]) -> Iterator[int]:
    """A server that answers with these bytes, one after the other, slowly or in pieces, and ends somehow."""
    listener = socket.create_server(("127.0.0.1", 0))
    ends, over = rng.random(20), threading.Event()

    def serve() -> None:
        for number in range(20):
            try:
                peer, _ = listener.accept()
            except OSError:
                return
            with suppress(OSError), peer:
                peer.settimeout(0.3)
                for answer in answers:
                    with suppress(TimeoutError):
                        peer.recv(1 << 16)
                    peer.sendall(answer if b"%KEY%" not in answer else b"")
                if ends[number] < 0.4:  # a reset instead of an end
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                elif ends[number] < 0.6:
                    over.wait(0.5)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield int(listener.getsockname()[1])
    finally:
        over.set()
        with suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(5)


@contextmanager
def upgraded(rng: Rng, frames: list[bytes]) -> Iterator[int]:
    """A WebSocket server that shakes hands properly and then writes raw bytes."""
    listener = socket.create_server(("127.0.0.1", 0))
    reset = rng.random() < 0.5

    def serve() -> None:
        for _ in range(20):
            try:
                peer, _ = listener.accept()
            except OSError:
                return
            with suppress(OSError), peer:
                peer.settimeout(0.5)
                protocol = ServerProtocol()
                while not (events := protocol.events_received()):
                    protocol.receive_data(peer.recv(1 << 16))
                if isinstance(events[0], Request):
                    protocol.send_response(protocol.accept(events[0]))
                    peer.sendall(b"".join(protocol.data_to_send()))
                for frame in frames:
                    peer.sendall(frame)
                    with suppress(TimeoutError):
                        peer.recv(1 << 16)
                if reset:
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield int(listener.getsockname()[1])
    finally:
        with suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(5)


def _ask(name: str) -> None:
    """One answer of a server, without pauses between attempts."""
    pauses, wire.PAUSES = wire.PAUSES, (0.0, 0.0)
    try:
        policy = make_policy(name)
        with closing(policy):  # type: ignore[type-var]
            policy.reset([start("one")])
            policy.act([seen("one")])
    finally:
        wire.PAUSES = pauses


def chaotic_websocket(rng: Rng, folder: Path) -> None:
    payload = frame_of(rng, {"actions": array_of(rng)}, "openpi")[:65535]
    first = bytes([int(rng.choice([0x82, 0x82, 0x82, 0x81, 0x88, 0x89, 0x02, 0xF2]))])
    length = bytes([len(payload)]) if len(payload) < 126 else struct.pack("!BH", 126, len(payload))
    frame = first + length + payload
    frames = [mutators.data(rng, frame) if rng.random() < 0.6 else frame for _ in range(2)]
    with upgraded(rng, frames[: int(rng.integers(3))]) as port:
        protocol = str(rng.choice(["openpi", "vla-eval"]))
        _ask(f"{protocol}:ws://127.0.0.1:{port}?camera=0&timeout=0.5")


def chaotic_handshake(rng: Rng, folder: Path) -> None:
    answer = b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    answer += b"Sec-WebSocket-Accept: x\r\n\r\n"
    with chaotic(rng, [mutators.data(rng, answer)]) as port:
        _ask(f"openpi:ws://127.0.0.1:{port}?camera=0&timeout=0.5")


def chaotic_http(rng: Rng, folder: Path) -> None:
    body = json.dumps({"actions": ACTIONS.tolist()}).encode()
    heads = (
        b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(body),
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n",
    )
    answers = [mutators.data(rng, heads[int(rng.integers(2))] + body)]
    if rng.random() < 0.2:
        answers = [b"HTTP/1.1 100 Continue\r\n\r\n" * int(rng.integers(1, 500)), *answers]
    with chaotic(rng, answers) as port:
        _ask(f"http://127.0.0.1:{port}/act?camera=0&timeout=0.5")


def chaotic_groot(rng: Rng, folder: Path) -> None:
    greeting = b"\xff\0\0\0\0\0\0\0\x01\x7f\x03\0NULL" + bytes(48)
    with chaotic(rng, [mutators.data(rng, greeting), mutators.data(rng, b"\x04\x26\x05READY" + bytes(30))]) as port:
        _ask(f"groot:tcp://127.0.0.1:{port}?camera=0&timeout=0.3")


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


SERVERS: dict[str, tuple[Reader, int]] = {
    "chaotic WebSockets": (chaotic_websocket, 600),
    "chaotic handshakes": (chaotic_handshake, 500),
    "chaotic HTTP": (chaotic_http, 600),
    "chaotic ZeroMQ": (chaotic_groot, 300),
    "requests to serve": (requests, 1500),
}
"""As ``READERS``."""
