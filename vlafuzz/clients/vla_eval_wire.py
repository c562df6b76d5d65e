"""vla-eval's wire format, protocol version 1: a WebSocket per session, with numbered msgpack messages."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from vlafuzz.clients.websocket_connection import WebSocketConnection
from vlafuzz.clients.wire import array_of, failure, short, with_retries
from vlafuzz.errors import Cause, PolicyError

Payload = Mapping[str, Any]


class Connection:
    """One session at a server."""

    def __init__(self, url: str, timeout: float) -> None:
        self._socket, self._number = WebSocketConnection(url, timeout), 0
        self.close = self._socket.close

    def send(self, kind: str, payload: Payload) -> int:
        """Send a message; returns its number, which the reply must repeat."""
        self._number += 1
        self._socket.send(pack(kind, payload, self._number))
        return self._number

    def receive(self, kind: str, number: int, wait: float | None = None) -> Payload:
        """The reply to message ``number``, within ``wait`` seconds; by default the session's timeout.

        Raises:
            PolicyError: no reply in time, an error message, or a reply of another kind or number.
        """
        frame = self._socket.receive(wait)
        try:
            received, payload, echoed = unpack(frame)
        except ValueError as error:
            raise self._error(f"not a vla-eval message: {error}", "protocol") from None
        if received == "error":
            raise self._error(short(payload.get("error")), "remote")
        if (received, echoed) != (kind, number):
            problem = f"expected the message {kind!r} with number {number}, got {received!r} with {echoed!r}"
            raise self._error(problem, "protocol")
        return payload

    def _error(self, message: str, cause: Cause) -> PolicyError:
        return failure(self._socket.url, message, cause)


def open_session(url: str, timeout: float, greeting: Payload) -> tuple[Connection, Payload]:
    """A new session, and the server's reply to the greeting.

    Raises:
        PolicyError: no server answers, or it speaks another protocol.
    """
    return with_retries(lambda: _open(url, timeout, greeting))


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
        ValueError: the frame is not a message.
    """
    if isinstance(frame, str):
        raise ValueError(f"the text {short(frame)!r}")
    try:
        message = msgpack.unpackb(frame, object_hook=_decode, raw=False)
    except Exception as error:  # msgpack and NumPy raise many types on malformed data
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None
    if not isinstance(message, dict) or not {"type", "payload", "seq"} <= message.keys():
        raise ValueError(f"no type, payload and number in {short(message)}")
    if not isinstance(message["payload"], dict):
        raise ValueError(f"a payload of {type(message['payload']).__name__}")
    return message["type"], message["payload"], message["seq"]


def _encode(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{type(value).__name__} cannot be sent")
    # Uncompressed: PNG compression of an image takes longer than simulating the step.
    return {
        "__ndarray__": True,
        "data": value.tobytes(),
        "dtype": value.dtype.str,
        "shape": list(value.shape),
    }


def _decode(value: dict[str, Any]) -> Any:
    if "__ndarray__" not in value:
        return value
    return array_of(value["data"], value["dtype"], value["shape"])
