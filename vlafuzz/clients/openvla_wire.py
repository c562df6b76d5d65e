"""The wire of OpenVLA's and OpenVLA-OFT's ``POST /act``: JSON, arrays as json-numpy writes them.

Equal to json-numpy 2.1.1. Some clients put the JSON into a string once more, and servers answer them alike.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from vlafuzz.clients.wire import array_of, short


def encode(value: object, *, twice: bool = False) -> bytes:
    """A value as JSON; ``twice``: as a string that holds it."""
    once = json.dumps(value, default=_encode)
    return (json.dumps(once) if twice else once).encode()


def request(message: Mapping[str, Any], *, twice: bool = False) -> bytes:
    """An observation; ``twice``: as a string under the key ``encoded``."""
    return encode({"encoded": encode(message).decode()} if twice else message)


def decode(body: bytes | str) -> Any:
    """What was encoded, once or twice.

    Raises:
        ValueError: no JSON, or an array in it that is none; the text of an error is no JSON either.
    """
    try:
        found = json.loads(body, object_hook=_decode)
        return json.loads(found, object_hook=_decode) if isinstance(found, str) else found
    except Exception as error:  # NumPy raises many kinds over what it cannot read
        text = body if isinstance(body, str) else body.decode("utf-8", "replace")
        raise ValueError(f"{short(text)}: {type(error).__name__}: {short(error)}") from None


def _encode(value: Any) -> Any:
    if not isinstance(value, np.ndarray | np.generic) or value.dtype.kind not in "biuf":
        raise TypeError(f"{type(value).__name__} cannot be sent")
    return {
        "__numpy__": base64.b64encode(value.tobytes()).decode(),
        "dtype": value.dtype.str,
        "shape": list(value.shape),
    }


def _decode(found: dict[str, Any]) -> Any:
    if "__numpy__" not in found:
        return found
    array = array_of(base64.b64decode(found["__numpy__"]), found["dtype"], found["shape"])
    return array if array.shape else array[()]
