"""Model servers whose n-th answer is a fault: the client says so in a sentence, and goes on afterwards."""

import json
import socket
import threading
import time
from contextlib import closing, suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from tests.attack import mutators
from tests.attack.reactions import is_fair
from tests.attack.readers import Reader, Rng
from tests.attack.wires import ACTIONS, HELLO, array_of, frame_of
from tests.policies.clients.served import seen, start
from tests.policies.clients.test_hostile import RESET, accepting
from vlafuzz.errors import PolicyError
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, pack_vla_eval, unpack_vla_eval
from vlafuzz.policies.harness import Harness
from vlafuzz.rollouts.policies import make_policy

BODY = json.dumps({"actions": ACTIONS.tolist()}).encode()
PAGE = b"<!doctype html><html><body>502 Bad Gateway</body></html>"


def _reply(body: bytes, status: bytes = b"200 OK", *headers: bytes) -> bytes:
    lines = [b"HTTP/1.1 " + status, b"Content-Length: %d" % len(body), *headers]
    return b"\r\n".join(lines) + b"\r\n\r\n" + body


def _http_fault(rng: Rng) -> bytes | None:
    """What comes instead of an answer; None for nothing at all."""
    number = rng.choice(["NaN", "Infinity", "-Infinity", "1e300", "1e999", "null", '"x"', "[]"])
    faults = (
        _reply(PAGE, b"500 Internal Server Error"),
        _reply(PAGE),
        _reply(b"", rng.choice([b"204 No Content", b"301 Moved", b"307 Temporary Redirect"]), b"Location: /"),
        _reply(BODY)[: int(rng.integers(200))],
        _reply(BODY.replace(b"0.01", str(number).encode(), 1)),
        _reply(json.dumps(mutators.tree(rng, json.loads(BODY))).encode()),
        mutators.data(rng, _reply(BODY)),
        b"",
        None,
    )
    return faults[int(rng.integers(len(faults)))]


def _roll(name: str, answers: int) -> None:
    """Ask as often as a run does: after a fault a new rollout begins, which the server answers properly."""
    pauses, wire.PAUSES = wire.PAUSES, (0.0, 0.0)
    try:
        policy = make_policy(name)
        with closing(policy):
            for episode in ("one", "two", "three"):
                try:
                    harness = Harness(policy, start(episode))
                    for _ in range(answers):
                        harness.action(partial(seen, episode))
                    return
                except PolicyError as error:
                    if not is_fair(error):
                        raise AssertionError(str(error)) from error
            raise AssertionError("the client does not recover")
    finally:
        wire.PAUSES = pauses


def failing_http(rng: Rng, folder: Path) -> None:
    """An HTTP server whose n-th answer is a fault."""
    fault, at, numbers = _http_fault(rng), int(rng.integers(8)), count()

    def talk(peer: socket.socket) -> None:
        peer.settimeout(1)
        with peer.makefile("rb") as lines:
            while head := lines.readline():
                while (line := lines.readline()).strip():
                    head += line
                length = int(head.lower().partition(b"content-length:")[2].split()[0])
                lines.read(length)
                if next(numbers) == at:
                    if fault is None:
                        time.sleep(0.3)
                    else:
                        peer.sendall(fault)
                    if rng.random() < 0.5:
                        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                    return
                peer.sendall(_reply(BODY))

    with accepting(talk) as port:
        _roll(f"http://127.0.0.1:{port}/act?camera=0&execute=1&timeout=0.2", 9)


class _Failing:
    """Sessions of a WebSocket server whose n-th answer is a fault."""

    def __init__(self, rng: Rng) -> None:
        self.protocol = str(rng.choice(["openpi", "vla-eval"]))
        self._rng, self._at, self._kind, self._numbers = rng, *map(int, rng.integers([8, 6])), count()

    def session(self, line: Any) -> None:
        with suppress(OSError, ConnectionClosed):
            (self._openpi if self.protocol == "openpi" else self._vla_eval)(line)

    def _openpi(self, line: Any) -> None:
        line.send(pack_openpi({}))
        for _ in line:
            if next(self._numbers) == self._at:
                self._fail(line, {"actions": array_of(self._rng)})
            else:
                line.send(pack_openpi({"actions": ACTIONS}))

    def _vla_eval(self, line: Any) -> None:
        for frame in line:
            asked, _, number = unpack_vla_eval(frame)
            if asked == "hello":
                line.send(pack_vla_eval("hello", HELLO, number))
            elif asked == "observation" and next(self._numbers) == self._at:
                payload = {"actions": array_of(self._rng)}
                self._fail(line, {"type": "action", "payload": payload, "seq": number, "timestamp": 0.0})
            elif asked == "observation":
                line.send(pack_vla_eval("action", {"actions": ACTIONS}, number))

    def _fail(self, line: Any, whole: Any) -> None:
        rng = self._rng
        match self._kind:
            case 0:
                line.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                line.socket.close()
            case 1:
                line.send(mutators.text(rng, "Traceback\nValueError: x").encode(errors="replace").decode())
            case 2:
                line.socket.sendall(mutators.data(rng, b"\x82\x7e\xff\xff" + BODY))
                line.socket.shutdown(socket.SHUT_RDWR)
            case 3:
                time.sleep(0.3)
            case _:
                line.send(frame_of(rng, whole, self.protocol))


def failing_websocket(rng: Rng, folder: Path) -> None:
    """A WebSocket server whose n-th answer is a fault."""
    faulty = _Failing(rng)
    listening = serve(faulty.session, "127.0.0.1", 0, compression=None, close_timeout=0.2)
    thread = threading.Thread(target=listening.serve_forever)
    thread.start()
    try:
        port = listening.socket.getsockname()[1]
        _roll(f"{faulty.protocol}:ws://127.0.0.1:{port}?camera=0&execute=1&timeout=0.2", 9)
    finally:
        listening.shutdown()
        thread.join()


FAILING: dict[str, tuple[Reader, int]] = {
    "n-th answer, HTTP": (failing_http, 3000),
    "n-th answer, WebSockets": (failing_websocket, 3000),
}
"""As ``READERS``."""
