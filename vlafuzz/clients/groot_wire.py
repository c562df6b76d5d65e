"""GR00T's wire: dictionaries in msgpack, arrays as the bytes of an .npy file or as msgpack-numpy writes them.

Written to Isaac-GR00T's ``gr00t/policy/server_client.py``. N1.6 writes .npy files; N1.7 writes as
msgpack-numpy 0.4.8 does, and reads both: so .npy files are what is sent.
"""

from __future__ import annotations

import io
import json
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.wire import KINDS, array_of, short

# What marks a model's keys, and under which names they come: N1.6, N1.7, and the copy in N1.7's examples.
MARKS, UNDER = ("__ModalityConfig_class__", "__ModalityConfig__"), ("as_json", "as_dict")


def pack(message: object) -> bytes:
    """A message as bytes."""
    return bytes(msgpack.packb(message, default=_encode))


def unpack(frame: bytes) -> Any:
    """A message; a model's keys come as plain dictionaries.

    Raises:
        ValueError: it is none.
    """
    try:
        return msgpack.unpackb(frame, object_hook=_decode)
    except Exception as error:  # msgpack and NumPy raise many kinds over what they cannot read
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None


def _encode(value: Any) -> Any:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in KINDS:
        raise TypeError(f"{type(value).__name__} cannot be sent")
    file = io.BytesIO()
    np.save(file, value, allow_pickle=False)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def _decode(found: dict[Any, Any]) -> Any:
    if "__ndarray_class__" in found:
        return _npy(found["as_npy"])
    if b"nd" in found:
        shape = found[b"shape"] if found[b"nd"] else ()  # else a single number
        return array_of(found[b"data"], found[b"type"], shape)
    if any(mark in found for mark in MARKS):
        told = next(found[key] for key in UNDER if key in found)
        return json.loads(told) if isinstance(told, str) else told
    return found


def _npy(data: bytes) -> NDArray[Any]:
    """The header is read here, so that an array is never larger than what came."""
    file = io.BytesIO(data)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, by_columns, kind = read[np.lib.format.read_magic(file)](file)
    array = array_of(file.read(), kind, shape[::-1] if by_columns else shape)
    return array.T if by_columns else array
