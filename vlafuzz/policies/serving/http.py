"""HTTP: a server that no client holds up, with bounds on connections and their time; OpenVLA's ``POST /act`` on it."""

import io
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from vlafuzz.policies.clients.openvla import ActOptions, decode, encode
from vlafuzz.policies.clients.wire import ROLLOUT, short
from vlafuzz.policies.serving.sessions import MAX_BYTES, ClientSession, ServedPolicy

ARRIVAL = 15.0  # seconds for a request to arrive once it has begun, and for a client to take the answer
CONNECTIONS = 256  # at a time; more than any number of simulators that share a server
SILENCE = 600.0  # seconds between two requests of a rollout: its simulator may be slow


class BoundedServer(ThreadingHTTPServer):
    """A connection beyond ``CONNECTIONS`` is closed at once."""

    daemon_threads = True
    block_on_close = False  # clients keep connections open
    request_queue_size = 128  # with the default of 5, the sixth simulator to start waits for a second

    def __init__(self, address: tuple[str, int], handler: type["BoundedHandler"]) -> None:
        self._room = threading.BoundedSemaphore(CONNECTIONS)
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that resets its connection is no error of ours."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class BoundedHandler(BaseHTTPRequestHandler):
    """A connection. ``silence``: seconds after which one without a request is closed."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    silence = ARRIVAL

    def setup(self) -> None:
        super().setup()
        self.rfile.close()
        self._arriving = _Arriving(self.connection, self.silence)
        self.rfile = io.BufferedReader(self._arriving)

    def handle_one_request(self) -> None:
        self._arriving.expect_next()
        super().handle_one_request()

    def answer(self, status: int, kind: str, body: bytes) -> None:
        """Send a whole answer, which nobody may keep."""
        self.connection.settimeout(ARRIVAL)
        try:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)
        except OSError:  # the client is gone, or does not read
            self.close_connection = True

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""


class _Arriving(io.RawIOBase):
    """The bytes of a connection. A socket's own time limit would begin anew with every byte."""

    def __init__(self, connection: socket.socket, silence: float) -> None:
        self._connection, self._silence = connection, silence
        self._until: float | None = None  # of the request that has begun

    def expect_next(self) -> None:
        """The next byte begins a request."""
        self._until = None

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._silence if self._until is None else self._until - time.monotonic()
        if left <= 0:
            raise TimeoutError
        self._connection.settimeout(left)
        count = self._connection.recv_into(buffer)
        self._until = self._until or time.monotonic() + ARRIVAL
        return count


@contextmanager
def listening(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer requests within the block, with a thread per connection; yields the port."""
    server = BoundedServer((address, port), type("Handler", (_Acting,), {"served": served}))
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Acting(BoundedHandler):
    """A connection, which is one rollout."""

    served: ServedPolicy
    silence = SILENCE
    _session: ClientSession | None = None

    def finish(self) -> None:
        if self._session:
            self._session.end()
        super().finish()

    def do_POST(self) -> None:
        """Answer an observation with an action, or with a list of actions."""
        try:
            actions = self._act(decode(self._body()))
            status, value = 200, actions[0] if len(actions) == 1 else list(actions)
        except (ValueError, TypeError) as error:
            status, value = 400, {"error": short(error)}
        except Exception as error:  # the client gets the policy's error, and the server keeps running
            status, value = 500, {"error": f"{type(error).__name__}: {short(error)}"}
        self.answer(status, "application/json", encode(value))

    def _body(self) -> bytes:
        if self.path.partition("?")[0] != "/act":
            raise ValueError(f"no {self.path!r} here, only /act")
        length = int(self.headers.get("Content-Length", 0))
        if not 0 < length <= MAX_BYTES:
            self.close_connection = True
            raise ValueError(f"a body of {length} bytes, expected 1 to {MAX_BYTES}")
        return self.rfile.read(length)

    def _act(self, message: Any) -> Any:
        if isinstance(message, dict) and "encoded" in message:
            message = decode(message["encoded"])
        if self._session is None:
            self._session = self.served.session(self.headers.get(ROLLOUT))
        if not isinstance(message, dict):
            raise ValueError(f"no observation, but {type(message).__name__}")
        keys = ActOptions()
        return self._session.act_on({keys.image_key: message.get("full_image"), **message}, keys)
