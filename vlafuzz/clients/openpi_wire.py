"""openpi's wire format: a WebSocket with msgpack dictionaries, in which arrays are marked by bytes keys.

It follows openpi-client 0.1.2, with frames equal byte by byte. The server first sends arbitrary metadata.
Then every observation gets one reply; an error is sent as text, and ends the connection.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from vlafuzz.clients.wire import KINDS, array_of, short


def pack(message: Mapping[str, Any]) -> bytes:
    """A message as bytes."""
    return bytes(msgpack.packb(message, default=_encode))


def unpack(frame: bytes) -> dict[Any, Any]:
    """A message from its bytes.

    Raises:
        ValueError: they are not a message.
    """
    try:
        message = msgpack.unpackb(frame, object_hook=_decode)
    except Exception as error:  # msgpack and NumPy raise many types on malformed data
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None
    if not isinstance(message, dict):
        raise ValueError(f"no dictionary, but {short(message)}")
    return message


def _encode(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in KINDS:
        return {
            b"__ndarray__": True,
            b"data": value.tobytes(),
            b"dtype": value.dtype.str,
            b"shape": value.shape,
        }
    if isinstance(value, np.generic) and value.dtype.kind in KINDS:
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _decode(value: dict[Any, Any]) -> Any:
    if b"__ndarray__" in value:
        return array_of(value[b"data"], value[b"dtype"], value[b"shape"])
    if b"__npgeneric__" in value:
        return np.asarray(value[b"data"], np.dtype(value[b"dtype"]))[()]
    return value
