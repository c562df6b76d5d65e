"""vla-eval's wire: one WebSocket a session, messages in msgpack with a number each, arrays as bytes.

Written to version 1 of its protocol.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from vlafuzz.clients.websocket_connection import Socket
from vlafuzz.clients.wire import array_of, failure, persistently, short
from vlafuzz.errors import Cause, PolicyError

Payload = Mapping[str, Any]


class Connection:
    """One session of a server."""

    def __init__(self, url: str, timeout: float) -> None:
        self._socket, self._number = Socket(url, timeout), 0
        self.close = self._socket.close

    def send(self, kind: str, payload: Payload) -> int:
        """The message's number, which its reply has to repeat."""
        self._number += 1
        self._socket.send(pack(kind, payload, self._number))
        return self._number

    def receive(self, kind: str, number: int, wait: float | None = None) -> Payload:
        """The reply to message ``number``; waits ``wait`` seconds, by default the session's timeout.

        Raises:
            PolicyError: none came in time, it is an error message, or it is no such reply.
        """
        frame = self._socket.receive(wait)
        try:
            found, payload, echoed = unpack(frame)
        except ValueError as error:
            raise self._error(f"not a vla-eval message: {error}", "protocol") from None
        if found == "error":
            raise self._error(short(payload.get("error")), "remote")
        if (found, echoed) != (kind, number):
            told = f"expected the message {kind!r} with number {number}, got {found!r} with {echoed!r}"
            raise self._error(told, "protocol")
        return payload

    def _error(self, told: str, cause: Cause) -> PolicyError:
        return failure(self._socket.url, told, cause)


def open_session(url: str, timeout: float, greeting: Payload) -> tuple[Connection, Payload]:
    """A new session and what the server said to the greeting.

    Raises:
        PolicyError: no server, or not one of this protocol.
    """
    return persistently(lambda: _open(url, timeout, greeting))


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
        raise ValueError(f"the text {short(frame)!r}")
    try:
        message = msgpack.unpackb(frame, object_hook=_decode, raw=False)
    except Exception as error:  # msgpack and NumPy raise many kinds over what they cannot read
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None
    if not isinstance(message, dict) or not {"type", "payload", "seq"} <= message.keys():
        raise ValueError(f"no type, payload and number in {short(message)}")
    if not isinstance(message["payload"], dict):
        raise ValueError(f"a payload of {type(message['payload']).__name__}")
    return message["type"], message["payload"], message["seq"]


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
    return array_of(found["data"], found["dtype"], found["shape"])
