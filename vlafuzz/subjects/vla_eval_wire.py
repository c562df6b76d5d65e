"""vla-eval's wire: one WebSocket a session, messages in msgpack with a number each, arrays as bytes.

Written to version 1 of its protocol. Replies come from outside: each is checked for size, type and number.
"""

from __future__ import annotations

import logging
import socket
import struct
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import connect

from vlafuzz.errors import Cause, SubjectError

Payload = Mapping[str, Any]
MOST_BYTES = 4 << 20  # of a reply; a hundred actions are 3 kB
OPENING = 10.0  # seconds for TCP and WebSocket to open
CLOSING = 2.0
PAUSES = (0.5, 1.0)  # seconds before the second attempt to open a session, and before the third
LOG = logging.getLogger(__name__)
LOG.addHandler(logging.NullHandler())  # what websockets logs is told as an error; nobody is to see it twice
_KINDS = "biuf"  # of arrays: boolean, integers, floating point


class Connection:
    """One session of a server."""

    def __init__(self, url: str, timeout: float) -> None:
        self._url, self._timeout, self._number = url, timeout, 0
        self._stack = ExitStack()
        with self._blamed(min(timeout, OPENING)):
            self._socket = self._stack.enter_context(
                connect(
                    url,
                    open_timeout=min(timeout, OPENING),
                    close_timeout=CLOSING,
                    compression=None,
                    max_size=MOST_BYTES,
                    logger=LOG,
                    ping_interval=None,  # a model that computes may hold the server's interpreter for long
                )
            )
        # A server that hangs stops reading: without this, a send would wait for ever.
        limit = struct.pack("ll", int(timeout), int(timeout % 1 * 1e6))
        self._socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)

    def send(self, kind: str, payload: Payload) -> int:
        """The message's number, which its reply has to repeat."""
        self._number += 1
        frame = pack(kind, payload, self._number)
        with self._blamed(self._timeout):
            self._socket.send(frame)
        return self._number

    def receive(self, kind: str, number: int, wait: float | None = None) -> Payload:
        """The reply to message ``number``; waits ``wait`` seconds, by default the session's timeout.

        Raises:
            SubjectError: none came in time, it is an error message, or it is no such reply.
        """
        wait = self._timeout if wait is None else wait
        with self._blamed(wait):
            frame = self._socket.recv(max(wait, 0.0))
        try:
            found, payload, echoed = unpack(frame)
        except ValueError as error:
            raise self._error(f"not a vla-eval message: {error}", "protocol") from None
        if found == "error":
            raise self._error(_short(payload.get("error")), "remote")
        if (found, echoed) != (kind, number):
            told = f"expected the message {kind!r} with number {number}, got {found!r} with {echoed!r}"
            raise self._error(told, "protocol")
        return payload

    def close(self) -> None:
        """End the session; it may be broken already."""
        with suppress(OSError, WebSocketException):
            self._stack.close()

    @contextmanager
    def _blamed(self, wait: float) -> Iterator[None]:
        """Whatever breaks on the way is the subject's error, with its cause."""
        try:
            yield
        except TimeoutError:
            raise self._late(wait) from None
        except ConnectionClosed as error:
            if isinstance(error.__cause__, BlockingIOError):  # SO_SNDTIMEO
                raise self._late(wait) from None
            if error.sent is not None and error.sent.code == 1009 and not error.rcvd_then_sent:
                raise self._error(f"a reply of more than {MOST_BYTES >> 20} MiB", "protocol") from None
            raise self._error(f"the connection broke: {_short(error)}", "connect") from None
        except (OSError, WebSocketException, ImportError) as error:  # a SOCKS proxy needs another package
            raise self._error(_short(getattr(error, "strerror", None) or error), "connect") from None

    def _late(self, wait: float) -> SubjectError:
        return self._error(f"no reply within {wait:.3g} s", "timeout", "the option timeout=… waits longer")

    def _error(self, told: str, cause: Cause, hint: str | None = None) -> SubjectError:
        return SubjectError(f"{self._url}: {told}", hint, cause)


def open_session(url: str, timeout: float, greeting: Payload) -> tuple[Connection, Payload]:
    """A new session and what the server said to the greeting.

    A connection that breaks meanwhile is tried again, twice: the server has no state of ours yet.

    Raises:
        SubjectError: no server, or not one of this protocol.
    """
    for pause in PAUSES:
        try:
            return _open(url, timeout, greeting)
        except SubjectError as error:
            if error.cause != "connect":
                raise
        time.sleep(pause)
    return _open(url, timeout, greeting)


def _open(url: str, timeout: float, greeting: Payload) -> tuple[Connection, Payload]:
    connection = Connection(url, timeout)
    try:
        return connection, connection.receive("hello", connection.send("hello", greeting))
    except BaseException:
        connection.close()
        raise


def pack(kind: str, payload: Payload, number: int) -> bytes:
    """A message as bytes."""
    message = {"type": kind, "payload": payload, "seq": number, "timestamp": time.time()}
    return bytes(msgpack.packb(message, default=_encode, use_bin_type=True))


def unpack(frame: bytes | str) -> tuple[str, Payload, int]:
    """Type, payload and number of a message.

    Raises:
        ValueError: it is none.
    """
    if isinstance(frame, str):
        raise ValueError(f"the text {_short(frame)!r}")
    try:
        message = msgpack.unpackb(frame, object_hook=_decode, raw=False)
    except Exception as error:  # msgpack and NumPy raise many kinds over what they cannot read
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {_short(error)}") from None
    if not isinstance(message, dict) or not {"type", "payload", "seq"} <= message.keys():
        raise ValueError(f"no type, payload and number in {_short(message)}")
    if not isinstance(message["payload"], dict):
        raise ValueError(f"a payload of {type(message['payload']).__name__}")
    return message["type"], message["payload"], message["seq"]


def actions_of(payload: Payload) -> NDArray[np.float64]:
    """The chunk of an action message: ``(steps, n)``, also of a single action ``(n,)``.

    Raises:
        ValueError: there are none, or they are no numbers.
    """
    if "actions" not in payload:
        raise ValueError(f"a reply without actions, but {_short(sorted(payload))}")
    actions = np.asarray(payload["actions"])  # a ragged list is a ValueError
    if actions.dtype.kind not in "iuf":
        raise ValueError(f"actions that are no numbers: {_short(payload['actions'])}")
    return np.atleast_2d(actions.astype(np.float64))


def _encode(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{type(value).__name__} cannot be sent")
    # Raw: compressing a picture as PNG takes longer than simulating the step.
    return {
        "__ndarray__": True,
        "data": value.tobytes(),
        "dtype": value.dtype.str,
        "shape": list(value.shape),
    }


def _decode(found: dict[str, Any]) -> Any:
    if "__ndarray__" not in found:
        return found
    dtype = np.dtype(found["dtype"])
    if dtype.kind not in _KINDS:
        raise ValueError(f"an array of {dtype}")
    return np.frombuffer(found["data"], dtype).reshape(found["shape"])


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= 300 else f"{text[:300]} …"
