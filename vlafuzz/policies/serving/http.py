"""An HTTP server that no client holds up: connections have threads, with bounds on their number and time."""

import io
import socket
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

ARRIVAL = 15.0  # seconds for a request to arrive once it has begun, and for a client to take the answer
CONNECTIONS = 256  # at a time; more than any number of simulators that share a server


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
