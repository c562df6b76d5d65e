"""GR00T's wire format: msgpack dictionaries, with arrays as .npy bytes or as msgpack-numpy writes them.

It follows Isaac-GR00T's ``gr00t/policy/server_client.py``. N1.6 writes .npy bytes; N1.7 writes like
msgpack-numpy 0.4.8 and reads both, so we send .npy bytes.
"""

from __future__ import annotations

import io
import json
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.wire import KINDS, array_of, short

# The marks of a modality config and the keys of its content: N1.6, N1.7, and the copy in N1.7's examples.
MARKS, UNDER = ("__ModalityConfig_class__", "__ModalityConfig__"), ("as_json", "as_dict")


def pack(message: object) -> bytes:
    """A message as bytes."""
    return bytes(msgpack.packb(message, default=_encode))


def unpack(frame: bytes) -> Any:
    """A message from its bytes; modality configs become plain dictionaries.

    Raises:
        ValueError: they are not a message.
    """
    try:
        return msgpack.unpackb(frame, object_hook=_decode)
    except Exception as error:  # msgpack and NumPy raise many types on malformed data
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None


def _encode(value: Any) -> Any:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in KINDS:
        raise TypeError(f"{type(value).__name__} cannot be sent")
    file = io.BytesIO()
    np.save(file, value, allow_pickle=False)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def _decode(value: dict[Any, Any]) -> Any:
    if "__ndarray_class__" in value:
        return _npy(value["as_npy"])
    if b"nd" in value:
        shape = value[b"shape"] if value[b"nd"] else ()  # else a single number
        return array_of(value[b"data"], value[b"type"], shape)
    if any(mark in value for mark in MARKS):
        config = next(value[key] for key in UNDER if key in value)
        return json.loads(config) if isinstance(config, str) else config
    return value


def _npy(data: bytes) -> NDArray[Any]:
    """An array from .npy bytes; reading the header here ensures that it is no larger than the data."""
    file = io.BytesIO(data)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, by_columns, kind = read[np.lib.format.read_magic(file)](file)
    array = array_of(file.read(), kind, shape[::-1] if by_columns else shape)
    return array.T if by_columns else array
