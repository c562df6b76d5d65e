"""Models behind openpi's policy server."""

import re
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.connections import WebSocketConnection
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, unpack_openpi
from vlafuzz.policies.clients.options import CommonOptions, ProfiledOptions
from vlafuzz.policies.clients.sessions import Session, Sessions


class OpenPiOptions(ProfiledOptions):
    """The user's options for the model. The default keys are those of openpi's own example."""

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
    server, start_it, packages = "openpi", "uv run scripts/serve_policy.py …", ("msgpack", "websockets")

    def _open(self, start: EpisodeStart | None) -> Session:
        headers = wire.rollout_header(start) if start else {}
        session = OpenPiSession(WebSocketConnection(self._url, self._options.timeout, headers))
        with wire.closed_on_error(session):
            session.receive()  # the server's metadata, which is arbitrary
        return session


class OpenPiSession(Session):
    """A rollout at such a server."""

    def ask(self, seen: Observation) -> None:
        self._connection.send(pack_openpi(self.model.message(seen)))
        self._unanswered.append(seen)

    def answer(self, wait: float) -> NDArray[np.float64]:
        actions = wire.actions_of(self.receive(wait))
        return self.model.actions(actions, self._unanswered.popleft())

    def receive(self, wait: float | None = None) -> dict[object, object]:
        """The next message; PolicyError when it is late, malformed, or the text of an error."""
        url, frame = self._connection.url, self._connection.receive(wait)
        if not isinstance(frame, str):
            with wire.read(f"{url}: not an openpi message"):
                return unpack_openpi(frame)
        last = wire.short(frame.strip().rpartition("\n")[2] or frame)  # of a traceback
        key = re.fullmatch(r"KeyError: '([^']+)'", last)
        sent = self.model.message(self._unanswered[0]) if self._unanswered else {}
        if key is None or not sent or key[1] in sent:
            raise wire.failure(url, last, "remote")
        says = f"{last}, which was not sent; sent were {', '.join(sent)}"
        raise wire.failure(url, says, "remote", self.model.sends(key[1]))
