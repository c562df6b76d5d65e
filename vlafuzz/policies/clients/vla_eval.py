"""Models behind servers of vla-eval's protocol."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz import __version__
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.options import CommonOptions, VlaEvalOptions
from vlafuzz.policies.clients.servers import Address, needed
from vlafuzz.policies.clients.sessions import Session, Sessions
from vlafuzz.policies.clients.vla_eval_spec import DeclaredModel, Hello

PROTOCOL_VERSION = 1
GREETING = {"harness_version": f"vlafuzz {__version__}", "protocol_version": PROTOCOL_VERSION}


class VlaEval(Sessions):
    """A model behind a vla-eval server; options follow a question mark: ?camera=256&wrist=1.

    Every live rollout has its own connection, since servers keep action chunks per connection; without it,
    the rollout cannot continue. The policy is not ``shared``: the server itself batches the observations of
    several connections, and workers that connect directly save a hop.
    """

    form: ClassVar[str] = "vla-eval:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")
    answers_batches: ClassVar[bool] = True
    options: ClassVar[type[CommonOptions]] = VlaEvalOptions
    server, start_it = "vla-eval", "vla-eval serve --config …"

    def __init__(self, address: Address) -> None:
        with needed(address.name):
            from vlafuzz.policies.clients import msgpack_wire, websocket_connection
        self._msgpack, self._connect = msgpack_wire, websocket_connection.WebSocketConnection
        super().__init__(address)

    def _described(self, first: VlaEvalSession) -> DeclaredModel:
        return DeclaredModel(self._name, first.hello, self._options)

    def _open(self, start: EpisodeStart | None) -> VlaEvalSession:
        session = VlaEvalSession(self._connect(self._url, self._options.timeout), self._msgpack)
        with wire.closed_on_error(session):
            session.greet()
        return session

    def _begin(self, start: EpisodeStart) -> Session:
        session: VlaEvalSession = super()._begin(start)
        with wire.closed_on_error(session):
            if self._described(session).spec != self.spec:
                raise wire.replaced(self._name)
            session.send("episode_start", {"task": _task(start)})
        return session


class VlaEvalSession(Session):
    """A rollout at such a server, with numbered messages. ``hello``: what the server declares."""

    hello: Hello

    def __init__(self, connection: Any, msgpack: Any) -> None:
        super().__init__(connection)
        self._msgpack, self._number = msgpack, 0

    def greet(self) -> None:
        greeting, url = self._receive("hello", self.send("hello", GREETING)), self._connection.url
        self.hello = wire.validated(Hello, url, "hello", greeting)
        if self.hello.protocol_version != PROTOCOL_VERSION:
            version = f"version {self.hello.protocol_version} of the protocol, not {PROTOCOL_VERSION}"
            hint = "install a vla-eval there that speaks it, such as 0.8.0"
            raise wire.failure(url, f"it speaks {version}", "protocol", hint)

    def ask(self, seen: Observation) -> None:
        self._unanswered.append(self.send("observation", self.model.message(seen)))

    def answer(self, wait: float) -> NDArray[np.float64]:
        return wire.actions_of(self._receive("action", self._unanswered.popleft(), wait))

    def end(self) -> None:
        """Send no metrics, since we judge the rollout ourselves."""
        self.send("episode_end", {"metrics": {}})

    def send(self, kind: str, payload: Mapping[str, Any]) -> int:
        """Send a message; returns its number, which the reply must repeat."""
        self._number += 1
        self._connection.send(self._msgpack.pack_vla_eval(kind, payload, self._number))
        return self._number

    def _receive(self, kind: str, number: int, wait: float | None = None) -> Mapping[str, Any]:
        """The reply to message ``number``; PolicyError when it is late, an error, or another message."""
        url, frame = self._connection.url, self._connection.receive(wait)
        with wire.read(f"{url}: not a vla-eval message"):
            received, payload, echoed = self._msgpack.unpack_vla_eval(frame)
        if received == "error":
            raise wire.failure(url, wire.short(payload.get("error")), "remote")
        if (received, echoed) != (kind, number):
            problem = f"expected the message {kind!r} with number {number}, got {received!r} with {echoed!r}"
            raise wire.failure(url, problem, "protocol")
        return payload  # type: ignore[no-any-return]


def _task(start: EpisodeStart) -> dict[str, Any]:
    suite, _, number = start.task.rpartition("/")  # some servers have settings for each suite
    place = {"suite": suite, "task_id": int(number)} if suite else {"suite": "vlafuzz"}
    task = {"name": start.instruction, "task": start.task}
    return task | place | {"episode": start.episode, "seed": start.seed}
