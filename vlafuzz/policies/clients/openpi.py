"""Models behind openpi's policy server."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.profiled import Model, ProfiledOptions
from vlafuzz.policies.clients.remote import Address, CommonOptions, needed
from vlafuzz.policies.clients.sessions import Sessions


class OpenPiOptions(ProfiledOptions):
    """The user's options for the model. The default keys are those of openpi's LIBERO models."""

    protocol: ClassVar[str] = "openpi"

    image_key: str = "observation/image"
    wrist_key: str = "observation/wrist_image"
    state_key: str = "observation/state"
    instruction_key: str = "prompt"


class OpenPi(Sessions):
    """A model behind openpi's policy server; it declares nothing, so name a profile: ?profile=libero.

    Every live rollout has its own connection, identified by a header that only our own server reads.
    """

    form: ClassVar[str] = "openpi:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")
    options: ClassVar[type[CommonOptions]] = OpenPiOptions

    def __init__(self, address: Address[OpenPiOptions]) -> None:
        super().__init__(address)
        with needed(address.name):
            from vlafuzz.policies.clients import msgpack_wire, websocket_connection
        self._msgpack, self._connect = msgpack_wire, websocket_connection.WebSocketConnection
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        with wire.required("openpi", "start it first: uv run scripts/serve_policy.py …"):
            self._begin(None).close()

    def _begin(self, start: EpisodeStart | None) -> OpenPiSession:
        return wire.with_retries(lambda: self._open(wire.rollout_header(start) if start else {}))

    def _open(self, headers: dict[str, str]) -> OpenPiSession:
        session = OpenPiSession(self._connect(self._url, self._timeout, headers), self._msgpack, self._model)
        with wire.closed_on_error(session):
            session.receive()  # the server's metadata, which is arbitrary
        return session


class OpenPiSession:
    """A ``Session`` at such a server."""

    def __init__(self, socket: Any, msgpack: Any, model: Model) -> None:
        self._socket, self._msgpack, self._model = socket, msgpack, model
        self._pending: deque[Observation] = deque()
        self.close = socket.close

    def ask(self, seen: Observation) -> None:
        self._socket.send(self._msgpack.pack_openpi(self._model.message(seen)))
        self._pending.append(seen)

    def answer(self, wait: float) -> NDArray[np.float64]:
        actions = wire.actions_of(self.receive(wait))
        return self._model.actions(actions, self._pending.popleft())

    def end(self) -> None:
        """The protocol cannot express it."""

    def receive(self, wait: float | None = None) -> dict[object, object]:
        """The next message; PolicyError when it is late, malformed, or the text of an error."""
        frame = self._socket.receive(wait)
        if isinstance(frame, str):  # a traceback, whose last line is the error
            last = wire.short(frame.strip().rpartition("\n")[2] or frame)
            key = re.fullmatch(r"KeyError: '([^']+)'", last)
            if key is None or not self._pending or key[1] in (sent := self._model.message(self._pending[0])):
                raise wire.failure(self._socket.url, last, "remote")
            says = f"{last}, which was not sent; sent were {', '.join(sent)}"
            raise wire.failure(self._socket.url, says, "remote", self._model.sends(key[1]))
        try:
            message: dict[object, object] = self._msgpack.unpack_openpi(frame)
        except ValueError as error:
            raise wire.failure(self._socket.url, f"not an openpi message: {error}", "protocol") from None
        return message
