"""Models behind ``POST /act``, as OpenVLA and OpenVLA-OFT are served.

The wire format is JSON, with arrays as json-numpy 2.1.1 writes them; servers may encode it as a string once more.
"""

import base64
import json
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.common.reading import array_of
from vlafuzz.policies.base import Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.options import CommonOptions, ProfiledOptions
from vlafuzz.policies.clients.sessions import Session, Sessions
from vlafuzz.policies.clients.wire import HttpConnection


class ActOptions(ProfiledOptions):
    """The user's options for the model. The default keys are OpenVLA's; OFT needs image_key=full_image.

    ``unnorm_key``: the data set whose statistics scale the actions; None for the model's default.
    """

    protocol: ClassVar[str] = "http"

    unnorm_key: str | None = None


class OpenVla(Sessions):
    """A model behind OpenVLA's or OpenVLA-OFT's /act, for instance with ?profile=bridge."""

    form: ClassVar[str] = "http://host:port/act"
    schemes: ClassVar[Sequence[str]] = ("http", "https")
    options: ClassVar[type[CommonOptions]] = ActOptions
    server, start_it = "/act", "python vla-scripts/deploy.py …"
    connection = HttpConnection

    def _send(self, session: Session, seen: Observation) -> None:
        options: ActOptions = self._options
        message = self._model.message(seen) | ({"unnorm_key": options.unnorm_key} if options.unnorm_key else {})
        session.connection.post(encode(message))

    def _receive(self, session: Session, seen: Observation, wait: float) -> Array:
        status, body = session.connection.reply(wait)
        url, text = self._url, body.decode("utf-8", "replace")
        if status != 200:
            raise wire.failure(url, f"HTTP {status}: {wire.short(text)}", "remote")
        if text.strip().strip('"') == "error":  # both servers send this with status 200
            raise wire.failure(url, 'it answers "error"', "remote", "the server's log says why")
        with wire.read(f"{url}: not a reply of /act"):
            reply: Any = decode(body)
        if not isinstance(reply, dict):
            return wire.numbers(reply)
        if "error" in reply:
            raise wire.failure(url, wire.short(reply["error"]), "remote")
        return wire.actions_of({"actions": reply["action"]} if "action" in reply else reply)


def encode(value: object) -> bytes:

    def written(array: Any) -> Any:
        wire.check_sendable(array, np.ndarray | np.generic)
        data = base64.b64encode(array.tobytes()).decode()
        return {"__numpy__": data, "dtype": array.dtype.str, "shape": list(array.shape)}

    return json.dumps(value, default=written).encode()


def decode(body: bytes | str) -> Any:
    """The value, whether it was encoded once or twice; ValueError for other text, or an invalid array."""
    try:
        value = _parsed(body)
        return _parsed(value) if isinstance(value, str) else value
    except Exception as error:  # NumPy raises many types on malformed data
        text = body if isinstance(body, str) else body.decode("utf-8", "replace")
        raise ValueError(f"{wire.short(text)}: {type(error).__name__}: {wire.short(error)}") from None


def _parsed(text: bytes | str) -> Any:
    def read(value: dict[str, Any]) -> Any:
        if "__numpy__" not in value:
            return value
        array = array_of(base64.b64decode(value["__numpy__"]), value["dtype"], value["shape"])
        return array if array.shape else array[()]

    signs = text if isinstance(text, bytes) else text.encode("utf-8", "replace")
    if sum(map(signs.count, (b"{", b"[", b","))) > wire.MOST_VALUES:  # base64 has none of them
        raise ValueError(f"more than {wire.MOST_VALUES} values")
    return json.loads(text, object_hook=read)
