"""A WebSocket to a model server. All failures are PolicyErrors with their cause."""

import logging
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress

from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import connect

from vlafuzz.errors import PolicyError
from vlafuzz.policies.clients.wire import MAX_BYTES, OPENING, blamed, failure, late, short, too_large

CLOSING = 2.0  # seconds
LOG = logging.getLogger(__name__)
LOG.addHandler(logging.NullHandler())  # what websockets logs is reported as an error already


class WebSocketConnection:
    """One connection."""

    def __init__(self, url: str, timeout: float, headers: Mapping[str, str] | None = None) -> None:
        self.url, self._timeout = url, timeout
        self._stack = ExitStack()
        with self._blamed(min(timeout, OPENING)):
            self._socket = self._stack.enter_context(
                connect(
                    url,
                    open_timeout=min(timeout, OPENING),
                    close_timeout=CLOSING,
                    compression=None,
                    max_size=MAX_BYTES,
                    logger=LOG,
                    additional_headers=headers,
                    ping_interval=None,  # a computing model may hold the server's interpreter lock for long
                )
            )
            # A server that hangs stops reading: without this, a send would block forever.
            limit = struct.pack("ll", int(timeout), int(timeout % 1 * 1e6))
            self._socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)

    def send(self, frame: bytes) -> None:
        with self._blamed(self._timeout):
            self._socket.send(frame)

    def receive(self, wait: float | None = None) -> bytes | str:
        """The next message, within ``wait`` seconds; by default the connection's timeout."""
        wait = self._timeout if wait is None else wait
        with self._blamed(wait):
            return self._socket.recv(max(wait, 0.0))

    def close(self) -> None:
        """Close the connection, which may be broken already."""
        with suppress(OSError, WebSocketException):
            self._stack.close()

    @contextmanager
    def _blamed(self, wait: float) -> Iterator[None]:
        try:
            with blamed(self.url, wait):
                yield
        except ConnectionClosed as error:
            raise self._broken(error, wait) from None
        except (WebSocketException, ImportError) as error:  # ImportError: of a SOCKS proxy's package
            raise failure(self.url, short(error), "connect") from None

    def _broken(self, error: ConnectionClosed, wait: float) -> PolicyError:
        if isinstance(error.__cause__, BlockingIOError):  # SO_SNDTIMEO
            return late(self.url, wait)
        if error.sent is not None and error.sent.code == 1009 and not error.rcvd_then_sent:
            return too_large(self.url)
        return failure(self.url, f"the connection broke: {short(error)}", "connect")
