"""Browsers that misbehave, and scripts that are none, on the page that `watch` serves."""

import socket
import threading
import time
import traceback
from contextlib import ExitStack, closing, suppress
from functools import cache
from http.client import HTTPConnection
from pathlib import Path
from socketserver import BaseServer

import pytest

from tests.attack import mutators, samples
from tests.attack.readers import Reader, Rng
from tests.policies.clients.test_hostile import RESET
from vlafuzz.report.live import Live, PageServer, live_page
from vlafuzz.store.store import Store

GET = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: keep-alive\r\nAccept: */*\r\n\r\n"
_SERVED, _CRASHES = ExitStack(), list[str]()


@cache
def _port() -> int:
    """Where a page is served until ``stop``; what would be a traceback on stderr is kept."""
    patch = _SERVED.enter_context(pytest.MonkeyPatch.context())
    patch.setattr(BaseServer, "handle_error", lambda *_: _CRASHES.append(traceback.format_exc()))
    with Store.open(samples.store()) as store:
        page = live_page(Live(store), None)
    server = _SERVED.enter_context(PageServer(0, lambda: page))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    _SERVED.callback(server.shutdown)
    return server.server_port


def stop() -> None:
    """End the server."""
    _SERVED.close()
    _port.cache_clear()


def watched(rng: Rng, folder: Path) -> None:
    """Malformed, slow and aborted requests, while another browser gets the page as ever."""
    port = _port()
    with ExitStack() as stack:
        for _ in range(int(rng.integers(1, 5))):
            _misbehave(rng, stack.enter_context(socket.create_connection(("127.0.0.1", port), 2)))
        with closing(HTTPConnection("127.0.0.1", port, timeout=4)) as line:
            line.request("GET", "/")
            answer = line.getresponse()
            assert (answer.status, b"</html>" in answer.read()) == (200, True)
    assert not _CRASHES, _CRASHES.pop()


def _misbehave(rng: Rng, peer: socket.socket) -> None:
    request = GET * int(rng.choice([1, 1, 2, 30]))
    if rng.random() < 0.7:
        request = mutators.data(rng, request)
    peer.settimeout(0.05)
    with suppress(OSError):
        match rng.integers(5):
            case 0:  # nothing, or not all of it
                peer.sendall(request[: int(rng.integers(len(request) + 1))])
            case 1:  # slowly
                for part in range(0, len(request), 40)[:5]:
                    peer.sendall(request[part : part + 40])
                    time.sleep(0.001)
            case 2:  # a load that is aborted
                peer.sendall(request)
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                peer.close()
            case 3:
                peer.sendall(request)
                peer.shutdown(socket.SHUT_WR)
                peer.recv(int(rng.integers(1, 5000)))
            case _:
                peer.sendall(request)
                peer.recv(1 << 16)


WATCHED: dict[str, tuple[Reader, int]] = {"browsers of watch": (watched, 4000)}
"""As ``READERS``."""
