"""Act: a model behind ``POST /act``, as OpenVLA and OpenVLA-OFT are served."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.http_connection import HttpLine
from vlafuzz.clients.openvla_wire import decode, request
from vlafuzz.clients.profiled import Model, Profiled
from vlafuzz.clients.remote import Address, Common
from vlafuzz.clients.sessions import Sessions
from vlafuzz.clients.wire import actions_of, failure, numbers, persistently, required, rollout_header, short
from vlafuzz.policies.base import EpisodeStart, Observation


class ActOptions(Profiled):
    """What the user says about the model. The keys are OpenVLA's; OFT has image_key=full_image.

    Attributes:
        unnorm_key: the data set whose statistics the model scales its actions with; None for its own choice.
        encoded: put the JSON into a string once more.
    """

    protocol: ClassVar[str] = "http"

    unnorm_key: str | None = None
    encoded: bool = False


class OpenVla(Sessions):
    """A model behind OpenVLA's or OpenVLA-OFT's /act, for instance with ?profile=bridge.

    A live rollout has a connection of its own, which a header names: our own server reads it, others do not.
    """

    form: ClassVar[str] = "http://host:port/act"
    schemes: ClassVar[Sequence[str]] = ("http", "https")
    options: ClassVar[type[Common]] = ActOptions

    def __init__(self, address: Address[ActOptions]) -> None:
        super().__init__(address.name, address.options.timeout)
        self._address = address
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        with required("/act", "start it first: python vla-scripts/deploy.py …"):
            self._open().close()

    def _begin(self, start: EpisodeStart) -> ActSession:
        return ActSession(self._open(), self._model, self._address.options, start)

    def _open(self) -> HttpLine:
        return persistently(lambda: HttpLine(self._address.url, self._address.options.timeout))


class ActSession:
    """One rollout at such a server."""

    def __init__(self, line: HttpLine, model: Model, options: ActOptions, start: EpisodeStart) -> None:
        self._line, self._model, self._options, self._start = line, model, options, start
        self._count = 0
        self.close = line.close

    def ask(self, seen: Observation) -> None:
        """Under the model's keys."""
        key = self._options.unnorm_key
        message = self._model.message(seen) | ({"unnorm_key": key} if key else {})
        headers = rollout_header(self._start, self._count)
        self._line.post(request(message, twice=self._options.encoded), headers)
        self._count += 1
        self._asked = seen  # one at a time: HTTP answers in order

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions."""
        return self._model.actions(self._actions(*self._line.reply(wait)), self._asked)

    def end(self) -> None:
        """The protocol has no word for it."""

    def _actions(self, status: int, body: bytes) -> NDArray[np.float64]:
        text = body.decode("utf-8", "replace")
        if status != 200:
            raise failure(self._line.url, f"HTTP {status}: {short(text)}", "remote")
        if text.strip().strip('"') == "error":  # with status 200, as both servers do
            raise failure(self._line.url, 'it answers "error"', "remote", "the server's log says why")
        try:
            found: Any = decode(body)
        except ValueError as error:
            raise failure(self._line.url, f"not a reply of /act: {error}", "protocol") from None
        if not isinstance(found, dict):
            return numbers(found)
        if "error" in found:
            raise failure(self._line.url, short(found["error"]), "remote")
        return actions_of({"actions": found["action"]} if "action" in found else found)
