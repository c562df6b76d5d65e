"""Wire format of OpenVLA's and OpenVLA-OFT's ``POST /act``: JSON, with arrays as json-numpy writes them.

Equal to json-numpy 2.1.1. Some clients encode the JSON as a string once more, which servers accept, too.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from vlafuzz.clients.wire import array_of, short


def encode(value: object, *, twice: bool = False) -> bytes:
    """A value as JSON; ``twice``: as a JSON string that holds the JSON."""
    once = json.dumps(value, default=_encode)
    return (json.dumps(once) if twice else once).encode()


def request(message: Mapping[str, Any], *, twice: bool = False) -> bytes:
    """The request with an observation; ``twice``: as a string under the key ``encoded``."""
    return encode({"encoded": encode(message).decode()} if twice else message)


def decode(body: bytes | str) -> Any:
    """The value, whether it was encoded once or twice.

    Raises:
        ValueError: the body is not JSON, as for the text of an error, or has an invalid array.
    """
    try:
        value = json.loads(body, object_hook=_decode)
        return json.loads(value, object_hook=_decode) if isinstance(value, str) else value
    except Exception as error:  # NumPy raises many types on malformed data
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


def _decode(value: dict[str, Any]) -> Any:
    if "__numpy__" not in value:
        return value
    array = array_of(base64.b64decode(value["__numpy__"]), value["dtype"], value["shape"])
    return array if array.shape else array[()]
