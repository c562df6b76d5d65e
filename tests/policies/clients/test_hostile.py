"""Servers that do what no protocol foresees: the client's error is a sentence that says whose fault it is."""

import json
import socket
import struct
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import msgpack
import numpy as np
import pytest
from websockets.server import ServerProtocol

from tests.policies.clients.served import HELLO, check_failure, failure, message, scripted
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.policies.clients import openvla
from vlafuzz.policies.clients.msgpack_wire import unpack, unpack_openpi, unpack_vla_eval
from vlafuzz.policies.clients.wire import short
from vlafuzz.rollouts.policies import make_policy

pytestmark = pytest.mark.usefixtures("no_pause")
RESET = struct.pack("ii", 1, 0)


@contextmanager
def accepting(talk: Callable[[socket.socket], None]) -> Iterator[int]:
    """A server that talks to one connection after the other; its port."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with suppress(OSError):  # closed
            while True:
                peer, _ = listener.accept()
                with suppress(OSError), peer:
                    talk(peer)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()


def resets_after_the_handshake(peer: socket.socket) -> None:
    protocol = ServerProtocol()
    while not (events := protocol.events_received()):
        protocol.receive_data(peer.recv(1 << 16))
    protocol.send_response(protocol.accept(events[0]))
    peer.sendall(b"".join(protocol.data_to_send()))
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)


@pytest.mark.parametrize("protocol", ["openpi", "vla-eval"])
def test_a_server_that_resets_right_after_the_handshake_is_none(protocol: str):
    with accepting(resets_after_the_handshake) as port:
        for _ in range(6):
            with pytest.raises(PrerequisiteError, match=f"no {protocol} server: ws://127.0.0.1:{port}"):
                make_policy(f"{protocol}:ws://127.0.0.1:{port}?camera=0&timeout=2")


@pytest.mark.parametrize(
    ("name", "called"),
    [
        ("vla-eval:ws://127.0.0.1:9", "vla-eval"),
        ("openpi:ws://127.0.0.1:9", "openpi"),
        ("http://127.0.0.1:9/act", "/act"),
        ("groot:tcp://127.0.0.1:9", "GR00T"),
    ],
)
def test_where_no_server_is_a_hint_says_how_to_start_one(name: str, called: str):
    with pytest.raises(PrerequisiteError, match=f"no {called} server: .*: Connection refused") as caught:
        make_policy(name)
    assert caught.value.hint.startswith("start it first")


def test_a_server_that_never_ends_its_reply_is_late():
    def talk(peer: socket.socket) -> None:
        peer.recv(1 << 16)
        peer.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 999\r\n\r\n")
        while not over.wait(0.05):
            peer.sendall(b" ")

    over = threading.Event()
    with accepting(talk) as port:
        error = failure(f"http://127.0.0.1:{port}/act?camera=0&timeout=0.3")
        over.set()
    check_failure(error, "timeout", r"no reply within 0\.\d+ s")


@pytest.mark.parametrize("change", [{"type": np.zeros(2)}, {"type": []}, {"seq": [1]}, {"payload": 3}])
def test_a_message_of_vla_eval_whose_parts_are_others_is_none(change):
    whole = {"type": "action", "payload": {}, "seq": 1, "timestamp": 0.0} | change

    def encode(array: np.ndarray) -> dict:
        data = {"data": array.tobytes(), "dtype": array.dtype.str, "shape": list(array.shape)}
        return {"__ndarray__": True} | data

    with pytest.raises(ValueError, match=r"^a (type|seq|payload) of "):
        unpack_vla_eval(msgpack.packb(whole, default=encode))


def test_a_server_that_declares_other_than_words_and_flags_is_none():
    for hello in ({"observation_params": {"send_state": [1, 2]}}, {"model_server": "x" * 5000}):
        server = scripted(lambda number: message("action", {}, number), hello=HELLO | hello)
        with server as name, pytest.raises(PrerequisiteError, match="its hello: "):
            make_policy(f"{name}?camera=0")


@pytest.mark.parametrize("kind", ["S1000000000", "O", "(10,10)f8", "M8[s]"])
def test_a_number_of_openpi_is_a_number(kind: str):
    packed = {b"__npgeneric__": True, b"data": 1, b"dtype": kind}
    with pytest.raises(ValueError, match="a number of"):
        unpack_openpi(msgpack.packb({"a": packed}))


def test_what_a_server_says_is_shown_in_one_line_without_what_steers_a_terminal():
    deep: list = []
    for _ in range(900):
        deep = [deep]
    assert short(deep) == "[[[[...]]]]"
    assert len(short({"a": "b" * 10_000})) <= 300
    error = PolicyError(f"a server: {short(chr(27) + '[2J' + chr(7))}")
    assert error.message == r"a server: \x1b[2J\x07"
    for depth, problem in ((50_000, "RecursionError"), (100_000, "more than 65536 values")):
        with pytest.raises(ValueError, match=problem):
            openvla.decode("[" * depth)
    assert json.loads("[]") == []


MAPS = msgpack.packb({"actions": [{}] * 1_000_000})


@pytest.mark.parametrize("unpack", [unpack_openpi, unpack_vla_eval, unpack])
@pytest.mark.parametrize("frame", [MAPS, msgpack.packb({"a": [[{}] * 1000] * 1000})], ids=["one list", "many"])
def test_a_message_of_very_many_containers_is_refused_before_they_are_built(unpack, frame):
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"65536"):
        unpack(frame)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20
