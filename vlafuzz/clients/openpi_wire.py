"""openpi's wire: one WebSocket, dictionaries in msgpack, arrays under keys that are bytes.

Written to openpi-client 0.1.2, whose frames ours equal byte by byte. The server speaks first: it says what it
likes about itself. Then each observation has one reply; an error is text, and ends the connection.
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
    """A message.

    Raises:
        ValueError: it is none.
    """
    try:
        message = msgpack.unpackb(frame, object_hook=_decode)
    except Exception as error:  # msgpack and NumPy raise many kinds over what they cannot read
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


def _decode(found: dict[Any, Any]) -> Any:
    if b"__ndarray__" in found:
        return array_of(found[b"data"], found[b"dtype"], found[b"shape"])
    if b"__npgeneric__" in found:
        return np.asarray(found[b"data"], np.dtype(found[b"dtype"]))[()]
    return found
