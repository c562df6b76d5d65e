"""Models behind ``POST /act``, as OpenVLA and OpenVLA-OFT are served."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.http_connection import HttpConnection
from vlafuzz.clients.openvla_wire import decode, request
from vlafuzz.clients.profiled import Model, ProfiledOptions
from vlafuzz.clients.remote import Address, CommonOptions
from vlafuzz.clients.sessions import Sessions
from vlafuzz.clients.wire import actions_of, failure, numbers, required, rollout_header, short, with_retries
from vlafuzz.policies.base import EpisodeStart, Observation


class ActOptions(ProfiledOptions):
    """The user's options for the model. The default keys are OpenVLA's; OFT needs image_key=full_image.

    Attributes:
        unnorm_key: the data set whose statistics scale the actions; None for the model's default.
        encoded: encode the JSON as a string once more.
    """

    protocol: ClassVar[str] = "http"

    unnorm_key: str | None = None
    encoded: bool = False


class OpenVla(Sessions):
    """A model behind OpenVLA's or OpenVLA-OFT's /act, for instance with ?profile=bridge.

    Every live rollout has its own connection, identified by a header that only our own server reads.
    """

    form: ClassVar[str] = "http://host:port/act"
    schemes: ClassVar[Sequence[str]] = ("http", "https")
    options: ClassVar[type[CommonOptions]] = ActOptions

    def __init__(self, address: Address[ActOptions]) -> None:
        super().__init__(address.name, address.options.timeout)
        self._address = address
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        with required("/act", "start it first: python vla-scripts/deploy.py …"):
            self._open().close()

    def _begin(self, start: EpisodeStart) -> ActSession:
        return ActSession(self._open(), self._model, self._address.options, start)

    def _open(self) -> HttpConnection:
        return with_retries(lambda: HttpConnection(self._address.url, self._address.options.timeout))


class ActSession:
    """One rollout at such a server."""

    def __init__(
        self, connection: HttpConnection, model: Model, options: ActOptions, start: EpisodeStart
    ) -> None:
        self._connection, self._model, self._options, self._start = connection, model, options, start
        self._sent = 0
        self.close = connection.close

    def ask(self, seen: Observation) -> None:
        """Send it under the model's keys."""
        key = self._options.unnorm_key
        message = self._model.message(seen) | ({"unnorm_key": key} if key else {})
        headers = rollout_header(self._start, self._sent)
        self._connection.post(request(message, twice=self._options.encoded), headers)
        self._sent += 1
        self._pending = seen  # one at a time: HTTP answers in order

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions."""
        return self._model.actions(self._actions(*self._connection.reply(wait)), self._pending)

    def end(self) -> None:
        """The protocol cannot express it."""

    def _actions(self, status: int, body: bytes) -> NDArray[np.float64]:
        url, text = self._connection.url, body.decode("utf-8", "replace")
        if status != 200:
            raise failure(url, f"HTTP {status}: {short(text)}", "remote")
        if text.strip().strip('"') == "error":  # both servers send this with status 200
            raise failure(url, 'it answers "error"', "remote", "the server's log says why")
        try:
            reply: Any = decode(body)
        except ValueError as error:
            raise failure(url, f"not a reply of /act: {error}", "protocol") from None
        if not isinstance(reply, dict):
            return numbers(reply)
        if "error" in reply:
            raise failure(url, short(reply["error"]), "remote")
        return actions_of({"actions": reply["action"]} if "action" in reply else reply)
