"""Wire formats in msgpack: openpi's, vla-eval's and GR00T's, which differ in how they write arrays.

openpi: a WebSocket with dictionaries, as in openpi-client 0.1.2, with frames equal byte by byte. The server first sends
arbitrary metadata. Then every observation gets one reply; an error is sent as text, and ends the connection. vla-eval,
protocol version 1: a WebSocket per session, with numbered messages. GR00T: as in Isaac-GR00T's
``gr00t/policy/server_client.py``. N1.6 writes .npy bytes; N1.7 writes like msgpack-numpy 0.4.8 and reads both, so we
send .npy bytes.
"""

import io
import json
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from vlafuzz.common.reading import KINDS, array_of, npy_array
from vlafuzz.policies.clients.wire import MOST_VALUES, check_sendable, short

# GR00T's marks of modality configs, and keys of their content: N1.6, N1.7, and the copy in N1.7's examples.
MARKS, UNDER = ("__ModalityConfig_class__", "__ModalityConfig__"), ("as_json", "as_dict")


def pack_openpi(message: Mapping[str, Any]) -> bytes:
    def encode(value: Any) -> Any:
        check_sendable(value, np.ndarray | np.generic)
        dtype = value.dtype.str
        if isinstance(value, np.generic):
            return {b"__npgeneric__": True, b"data": value.item(), b"dtype": dtype}
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": dtype, b"shape": value.shape}

    return _pack(message, encode)


def unpack_openpi(frame: bytes) -> dict[Any, Any]:
    """A message from its bytes; ValueError when they are none."""
    message = unpack(frame)
    if not isinstance(message, dict):
        raise ValueError(f"no dictionary, but {short(message)}")
    return message


def pack_vla_eval(kind: str, payload: Mapping[str, Any], number: int) -> bytes:
    def encode(value: Any) -> Any:
        check_sendable(value)
        # Uncompressed: PNG compression of an image takes longer than simulating the step.
        return {"__ndarray__": True, "data": value.tobytes(), "dtype": value.dtype.str, "shape": list(value.shape)}

    return _pack({"type": kind, "payload": payload, "seq": number, "timestamp": time.time()}, encode)


def unpack_vla_eval(frame: bytes | str) -> tuple[str, Mapping[str, Any], int]:
    """Type, payload and number of a message; ValueError when the frame is none."""
    if isinstance(frame, str):
        raise ValueError(f"the text {short(frame)!r}")
    message = unpack(frame)
    if not isinstance(message, dict) or not {"type", "payload", "seq"} <= message.keys():
        raise ValueError(f"no type, payload and number in {short(message)}")
    for key, kind in (("type", str), ("payload", dict), ("seq", int)):
        if not isinstance(message[key], kind):
            raise ValueError(f"a {key} of {type(message[key]).__name__}")
    return message["type"], message["payload"], message["seq"]


def pack_groot(message: object) -> bytes:
    def encode(value: Any) -> Any:
        check_sendable(value)
        file = io.BytesIO()
        np.save(file, value, allow_pickle=False)
        return {"__ndarray_class__": True, "as_npy": file.getvalue()}

    return _pack(message, encode)


def _pack(message: object, encode: Callable[[Any], Any]) -> bytes:
    import msgpack

    return bytes(msgpack.packb(message, default=encode))


def unpack(frame: bytes) -> Any:
    """A message of any of the formats, GR00T's modality configs as plain dictionaries; ValueError when it is none."""
    import msgpack

    left = MOST_VALUES

    def counted(values: Any) -> Any:
        nonlocal left
        left -= 1 + len(values)
        if left < 0:
            raise ValueError(f"more than {MOST_VALUES} values")
        return values

    most = {"max_array_len": MOST_VALUES, "max_map_len": MOST_VALUES}
    try:
        return msgpack.unpackb(frame, object_hook=lambda values: _decode(counted(values)), list_hook=counted, **most)
    except Exception as error:  # msgpack and NumPy raise many types on malformed data
        raise ValueError(f"{len(frame)} bytes, {type(error).__name__}: {short(error)}") from None


def _decode(value: dict[Any, Any]) -> Any:
    """What a dictionary stands for: in openpi's messages an array or a number, in the others' an array or a config."""
    if b"__ndarray__" in value:
        return array_of(value[b"data"], value[b"dtype"], value[b"shape"])
    if b"__npgeneric__" in value:
        kind = np.dtype(value[b"dtype"])
        if kind.kind not in KINDS:
            raise ValueError(f"a number of {kind}")
        return np.asarray(value[b"data"], kind)[()]
    if "__ndarray__" in value:
        return array_of(value["data"], value["dtype"], value["shape"])
    if "__ndarray_class__" in value:
        return npy_array(value["as_npy"])
    if b"nd" in value:
        shape = value[b"shape"] if value[b"nd"] else ()  # else a single number
        return array_of(value[b"data"], value[b"type"], shape)
    if any(mark in value for mark in MARKS):
        config = next(value[key] for key in UNDER if key in value)
        return json.loads(config) if isinstance(config, str) else config
    return value
