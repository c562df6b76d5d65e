"""What the clients of all model servers share: connections by HTTP, WebSocket and ZeroMQ, their errors, and retries.

Replies are untrusted. Every failure is a PolicyError with its cause.
"""

import logging
import select
import socket
import struct
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from typing import Any, TypeVar
from urllib.parse import urlsplit

import numpy as np
from pydantic import ValidationError

from vlafuzz.common.arrays import Array
from vlafuzz.common.reading import KINDS, first_problem
from vlafuzz.common.text import shortened
from vlafuzz.errors import Cause, PolicyError, PrerequisiteError, sentence

MOST_VALUES = 1 << 16  # in the lists and maps of a message, where a byte may become 80; arrays are one each
PAUSES = (0.5, 1.0)  # seconds before the second and the third attempt
UNANSWERED: tuple[Cause, ...] = ("connect", "timeout")
LOG = logging.getLogger(__name__)  # one line per retry
MAX_BYTES = 4 << 20  # of a reply; a hundred actions take 3 kB
OPENING = 10.0  # seconds for a connection to open
CLOSING = 2.0  # seconds
_SOCKETS = logging.getLogger(f"{__name__}.sockets")
_SOCKETS.addHandler(logging.NullHandler())  # what websockets logs is reported as an error already
T = TypeVar("T")


def failure(url: str, message: str, cause: Cause, hint: str | None = None) -> PolicyError:
    """A PolicyError that names the server."""
    return PolicyError(f"{url}: {message}", hint, cause)


def replaced(name: str) -> PolicyError:
    """The error for a server that declares something else than the one before it."""
    return PolicyError(f"{name}: another server answers than at the beginning of the run", cause="protocol")


@contextmanager
def read(what: str, cause: Cause = "protocol") -> Iterator[None]:
    """Convert a ValueError in the block, which reads a message or actions, to a PolicyError."""
    try:
        yield
    except ValueError as error:
        problem = first_problem(error) if isinstance(error, ValidationError) else error
        raise PolicyError(f"{what}: {problem}", cause=cause) from None


@contextmanager
def required(protocol: str, start: str) -> Iterator[None]:
    """Open the first connection in the block; PrerequisiteError, with ``start`` as hint, without a server."""
    try:
        yield
    except PolicyError as error:
        raise PrerequisiteError(f"no {protocol} server: {error.message}", hint=error.hint or start) from None


def with_retries(attempt: Callable[[], T]) -> T:
    """The result of ``attempt``, which is repeated up to twice when it cannot connect.

    Retry only what leaves no state in the server: opening a connection, or a request to a stateless server.
    """
    for pause in PAUSES:
        try:
            return attempt()
        except PolicyError as error:
            check_repeatable(error, pause, ("connect",))
        time.sleep(pause)
    return attempt()


def check_repeatable(error: PolicyError, pause: float, causes: Collection[str]) -> None:
    """Raise an error that has none of the causes; else log that the attempt is repeated after the pause."""
    if error.cause not in causes:
        raise error
    LOG.warning("%s; again in %g s", error, pause)


def actions_of(reply: Mapping[Any, Any]) -> Array:
    """The ``actions`` of a reply, see ``numbers``; ValueError when there are none."""
    if "actions" not in reply:
        raise ValueError(f"a reply without actions, but {short(sorted(map(str, reply)))}")
    return numbers(reply["actions"])


def numbers(value: object) -> Array:
    """Actions as ``(steps, n)``, a single action ``(n,)`` as one step; ValueError when not of numbers."""
    actions = np.asarray(value)  # a ragged list raises ValueError
    if actions.dtype.kind not in "iuf":
        raise ValueError(f"actions that are no numbers: {short(value)}")
    with np.errstate(over="ignore"):  # infinity is refused later, like any other action that is not finite
        return np.atleast_2d(actions.astype(np.float64))


def check_sendable(value: Any, kind: Any = np.ndarray) -> None:
    """Raise TypeError for what is no array of numbers."""
    if not isinstance(value, kind) or value.dtype.kind not in KINDS:
        raise TypeError(f"{type(value).__name__} cannot be sent")


def short(value: object) -> str:
    """A text, an error or another value as one line of at most 300 characters."""
    return sentence(value) if isinstance(value, str | Exception) else shortened(value, 300)


def _late(url: str, wait: float) -> PolicyError:
    return failure(url, f"no reply within {wait:.3g} s", "timeout", "the option timeout=… waits longer")


def _too_large(url: str) -> PolicyError:
    return failure(url, f"a reply of more than {MAX_BYTES >> 20} MiB", "protocol")


@contextmanager
def _blamed(url: str, wait: float) -> Iterator[None]:
    """Convert the errors of a socket in the block to PolicyErrors; it waits for ``wait`` seconds."""
    try:
        yield
    except TimeoutError:
        raise _late(url, wait) from None
    except (OSError, UnicodeError) as error:  # UnicodeError: of an invalid host name
        raise failure(url, short(getattr(error, "strerror", None) or error), "connect") from None
    except HTTPException as error:
        raise failure(url, f"not HTTP: {type(error).__name__}: {short(error)}", "protocol") from None


class HttpConnection:
    """An HTTP connection that stays open between requests, and is reopened when the server has closed it."""

    def __init__(self, url: str, timeout: float) -> None:
        self.url, self._timeout = url, timeout
        parts = urlsplit(url)
        kind = HTTPSConnection if parts.scheme == "https" else HTTPConnection
        self._path = parts.path or "/act"
        self._line = kind(parts.hostname or "", parts.port, timeout=min(timeout, OPENING))
        with _blamed(url, min(timeout, OPENING)):
            self._line.connect()
        self.close = self._line.close

    def post(self, body: bytes) -> None:
        with _blamed(self.url, self._timeout):
            if self._line.sock is None or _closed(self._line.sock):
                self._line.close()
                self._line.connect()
            self._line.sock.settimeout(self._timeout)
            self._line.request("POST", self._path, body, {"Content-Type": "application/json"})

    def reply(self, wait: float) -> tuple[int, bytes]:
        """Status and body of the response, of which something has to come within ``wait`` seconds, and then all."""
        until = time.monotonic() + wait
        with _blamed(self.url, self._timeout):
            self._line.sock.settimeout(max(wait, 0.001))
            with self._line.getresponse() as response:
                body = b""
                while more := response.read1(1 << 16):
                    body += more
                    if len(body) > MAX_BYTES:
                        raise _too_large(self.url)
                    if time.monotonic() > until:
                        raise TimeoutError
        return response.status, body


def _closed(sock: socket.socket) -> bool:
    """Whether the server closed an idle connection: no reply is pending, so readable data means its end."""
    poll = select.poll()
    poll.register(sock, select.POLLIN)
    return bool(poll.poll(0))


class WebSocketConnection:
    """A WebSocket."""

    def __init__(self, url: str, timeout: float) -> None:
        from websockets.sync import client

        self.url, self._timeout = url, timeout
        self._stack = ExitStack()
        with self._blamed(min(timeout, OPENING)):
            self._socket = self._stack.enter_context(  # as a function, `connect` is deprecated
                client.connect(
                    url,
                    open_timeout=min(timeout, OPENING),
                    close_timeout=CLOSING,
                    compression=None,
                    max_size=MAX_BYTES,
                    logger=_SOCKETS,
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
        with self._blamed(self._timeout):  # a message names what was asked for, not what was left of it
            return self._socket.recv(max(wait, 0.0))

    def close(self) -> None:
        """Close the connection, which may be broken already."""
        from websockets.exceptions import WebSocketException

        with suppress(OSError, WebSocketException):
            self._stack.close()

    @contextmanager
    def _blamed(self, wait: float) -> Iterator[None]:
        from websockets.exceptions import ConnectionClosed, WebSocketException

        try:
            with _blamed(self.url, wait):
                yield
        except ConnectionClosed as error:
            if isinstance(error.__cause__, BlockingIOError):  # SO_SNDTIMEO
                raise _late(self.url, wait) from None
            if error.sent is not None and error.sent.code == 1009 and not error.rcvd_then_sent:
                raise _too_large(self.url) from None
            raise failure(self.url, f"the connection broke: {short(error)}", "connect") from None
        except (WebSocketException, ImportError) as error:  # ImportError: of a SOCKS proxy's package
            raise failure(self.url, short(error), "connect") from None


class ZmqConnection:
    """A ZeroMQ connection; after an error it is useless, since a request without a reply blocks the next one.

    ZeroMQ connects in the background and waits forever, so a plain TCP connection checks for a server first.
    """

    def __init__(self, url: str, timeout: float) -> None:
        import zmq

        self.url, self._timeout, self._zmq = url, timeout, zmq
        parts = urlsplit(url)
        with _blamed(url, min(timeout, OPENING)):
            socket.create_connection((parts.hostname, parts.port), min(timeout, OPENING)).close()
        self._context: Any = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_BYTES)
        self._socket.setsockopt(zmq.SNDTIMEO, int(timeout * 1000))
        self._lost = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._socket.connect(url)

    def ask(self, frame: bytes) -> bytes:
        """The reply to a request; PolicyError when it does not come in time, or the connection broke."""
        zmq = self._zmq
        try:
            self._socket.send(frame)
            poller = zmq.Poller()
            poller.register(self._socket, zmq.POLLIN)
            poller.register(self._lost, zmq.POLLIN)
            ready = dict(poller.poll(int(self._timeout * 1000)))
            if self._socket in ready:
                return bytes(self._socket.recv())
        except zmq.Again:
            raise _late(self.url, self._timeout) from None
        except zmq.ZMQError as error:
            raise failure(self.url, short(error), "connect") from None
        if not ready:
            raise _late(self.url, self._timeout)
        message = f"the connection broke, or a reply has more than {MAX_BYTES >> 20} MiB"
        raise failure(self.url, message, "connect")

    def close(self) -> None:
        self._socket.disable_monitor()
        self._context.destroy(linger=0)
