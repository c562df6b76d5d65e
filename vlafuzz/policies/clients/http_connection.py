"""An HTTP connection for one request at a time. All failures are PolicyErrors with their cause."""

import select
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from urllib.parse import urlsplit

from vlafuzz.errors import PolicyError
from vlafuzz.policies.clients.wire import MAX_BYTES, OPENING, blamed, failure, late, short, too_large


class HttpConnection:
    """A connection that stays open between requests, and is reopened when the server has closed it."""

    def __init__(self, url: str, timeout: float) -> None:
        self.url, self._timeout = url, timeout
        parts = urlsplit(url)
        kind = HTTPSConnection if parts.scheme == "https" else HTTPConnection
        self._path = parts.path or "/act"
        self._line = kind(parts.hostname or "", parts.port, timeout=min(timeout, OPENING))
        with self._blamed(min(timeout, OPENING)):
            self._line.connect()
        self.close = self._line.close

    def post(self, body: bytes, headers: Mapping[str, str]) -> None:
        with self._blamed(self._timeout):
            if self._line.sock is None or _closed(self._line.sock):
                self._line.close()
                self._line.connect()
            self._line.sock.settimeout(self._timeout)
            self._line.request("POST", self._path, body, {"Content-Type": "application/json", **headers})

    def reply(self, wait: float) -> tuple[int, bytes]:
        """Status and body of the response, within ``wait`` seconds."""
        over = threading.Event()
        # A socket's own timeout begins anew with every byte.
        timer = threading.Timer(max(wait, 0.001), _end, [self._line.sock, over])
        timer.daemon = True
        timer.start()
        try:
            status, body = self._read(wait)
        except PolicyError:
            if not over.is_set():
                raise
        finally:
            timer.cancel()
        if over.is_set():
            raise late(self.url, wait)
        return status, body

    def _read(self, wait: float) -> tuple[int, bytes]:
        with self._blamed(wait):
            self._line.sock.settimeout(max(wait, 0.001))
            with self._line.getresponse() as response:
                body = b""
                while more := response.read1(1 << 16):
                    body += more
                    if len(body) > MAX_BYTES:
                        raise too_large(self.url)
        return response.status, body

    @contextmanager
    def _blamed(self, wait: float) -> Iterator[None]:
        try:
            with blamed(self.url, wait):
                yield
        except HTTPException as error:
            raise failure(self.url, f"not HTTP: {type(error).__name__}: {short(error)}", "protocol") from None


def _end(sock: socket.socket, over: threading.Event) -> None:
    over.set()
    with suppress(OSError):  # closed already
        sock.shutdown(socket.SHUT_RDWR)


def _closed(sock: socket.socket) -> bool:
    """Whether the server closed an idle connection: no reply is pending, so readable data means its end."""
    poll = select.poll()
    poll.register(sock, select.POLLIN)
    return bool(poll.poll(0))
