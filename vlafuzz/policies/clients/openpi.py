"""Models behind openpi's policy server."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from vlafuzz.common.arrays import Array
from vlafuzz.policies.base import Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.msgpack_wire import pack_openpi, unpack_openpi
from vlafuzz.policies.clients.options import CommonOptions, ProfiledOptions
from vlafuzz.policies.clients.sessions import Session, Sessions
from vlafuzz.policies.clients.wire import WebSocketConnection


class OpenPiOptions(ProfiledOptions):
    """The user's options for the model. The default keys are those of openpi's own example."""

    protocol: ClassVar[str] = "openpi"

    image_key: str = "observation/image"
    wrist_key: str = "observation/wrist_image"
    state_key: str = "observation/state"
    instruction_key: str = "prompt"


class OpenPi(Sessions):
    """A model behind openpi's policy server; it declares nothing, so name a profile."""

    form: ClassVar[str] = "openpi:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")
    options: ClassVar[type[CommonOptions]] = OpenPiOptions
    server, start_it, packages = "openpi", "uv run scripts/serve_policy.py …", ("msgpack", "websockets")
    connection = WebSocketConnection

    def _greet(self, session: Session) -> None:
        self._next(session, {})  # the server's metadata, which is arbitrary

    def _send(self, session: Session, seen: Observation) -> None:
        session.connection.send(pack_openpi(self._model.message(seen)))

    def _receive(self, session: Session, seen: Observation, wait: float) -> Array:
        return wire.actions_of(self._next(session, self._model.message(seen), wait))

    def _next(self, session: Session, sent: Mapping[str, Any], wait: float | None = None) -> dict[Any, Any]:
        """The next message; PolicyError when it is late, malformed, or the text of an error."""
        frame = session.connection.receive(wait)
        if not isinstance(frame, str):
            with wire.read(f"{self._url}: not an openpi message"):
                return unpack_openpi(frame)
        last = wire.short(frame.strip().rpartition("\n")[2] or frame)  # of a traceback
        key = re.fullmatch(r"KeyError: '([^']+)'", last)
        if key is None or not sent or key[1] in sent:
            raise wire.failure(self._url, last, "remote")
        says = f"{last}, which was not sent; sent were {', '.join(sent)}"
        hint = f"name a profile, or the model's own keys: image_key=…, wrist=1&wrist_key=…, state=1&state_key={key[1]}"
        raise wire.failure(self._url, says, "remote", hint)
