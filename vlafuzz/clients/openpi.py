"""OpenPi: a model behind openpi's policy server."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.profiled import Model, Profiled
from vlafuzz.clients.remote import Address, Common, needed
from vlafuzz.clients.sessions import Sessions
from vlafuzz.clients.wire import actions_of, failure, persistently, required, rollout_header, short
from vlafuzz.policies.base import EpisodeStart, Observation

if TYPE_CHECKING:
    from vlafuzz.clients.websocket_connection import Socket


class OpenPiOptions(Profiled):
    """What the user says about the model. The keys are those of openpi's LIBERO models."""

    protocol: ClassVar[str] = "openpi"

    image_key: str = "observation/image"
    wrist_key: str = "observation/wrist_image"
    state_key: str = "observation/state"
    instruction_key: str = "prompt"


class OpenPi(Sessions):
    """A model behind openpi's policy server; it declares nothing, so name a profile: ?profile=libero.

    A live rollout has a connection of its own, which a header names: our own server reads it, others do not.
    """

    form: ClassVar[str] = "openpi:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")
    options: ClassVar[type[Common]] = OpenPiOptions

    def __init__(self, address: Address[OpenPiOptions]) -> None:
        super().__init__(address.name, address.options.timeout)
        with needed(address.name):
            from vlafuzz.clients import openpi_wire
            from vlafuzz.clients import websocket_connection as sockets
        self._address, self._wire, self._sockets = address, openpi_wire, sockets
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        with required("openpi", "start it first: uv run scripts/serve_policy.py …"):
            self._begin(None).close()

    def _begin(self, start: EpisodeStart | None) -> OpenPiSession:
        return persistently(lambda: self._open(rollout_header(start) if start else {}))

    def _open(self, headers: dict[str, str]) -> OpenPiSession:
        socket = self._sockets.Socket(self._address.url, self._address.options.timeout, headers)
        session = OpenPiSession(socket, self._wire, self._model)
        try:
            session.receive()  # what the server says about itself: nothing that we could rely on
        except BaseException:
            socket.close()
            raise
        return session


class OpenPiSession:
    """One rollout at such a server."""

    def __init__(self, socket: Socket, wire: ModuleType, model: Model) -> None:
        self._socket, self._wire, self._model = socket, wire, model
        self._asked: deque[Observation] = deque()
        self.close = socket.close

    def ask(self, seen: Observation) -> None:
        """Under the model's keys."""
        self._socket.send(self._wire.pack(self._model.message(seen)))
        self._asked.append(seen)

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions."""
        found = actions_of(self.receive(wait))
        return self._model.actions(found, self._asked.popleft())

    def end(self) -> None:
        """The protocol has no word for it."""

    def receive(self, wait: float | None = None) -> dict[object, object]:
        """The next message.

        Raises:
            PolicyError: none in time, not one of this protocol, or the text of an error.
        """
        frame = self._socket.receive(wait)
        if isinstance(frame, str):  # a traceback, whose last line says most
            raise failure(self._socket.url, short(frame.strip().rpartition("\n")[2] or frame), "remote")
        try:
            message: dict[object, object] = self._wire.unpack(frame)
        except ValueError as error:
            raise failure(self._socket.url, f"not an openpi message: {error}", "protocol") from None
        return message
