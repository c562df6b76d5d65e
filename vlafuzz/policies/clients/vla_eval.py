"""Models behind servers of vla-eval's protocol."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz import __version__
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.conventions import LAYOUTS, sent
from vlafuzz.policies.clients.remote import Address, CommonOptions, VlaEvalOptions, needed
from vlafuzz.policies.clients.sessions import Sessions
from vlafuzz.policies.clients.vla_eval_spec import Hello, layout_of, picture_names, spec_of, wants_short_turns

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

    def __init__(self, address: Address[VlaEvalOptions]) -> None:
        super().__init__(address)
        with needed(address.name):
            from vlafuzz.policies.clients import msgpack_wire, websocket_connection
        self._msgpack, self._connect = msgpack_wire, websocket_connection.WebSocketConnection
        self._options = address.options
        with wire.required("vla-eval", "start it first: vla-eval serve --config …"):
            session, hello = wire.with_retries(self._open)
        session.close()
        self.spec = spec_of(self._name, hello, self._options)
        self._messages = Messages(self._name, hello, self._options)

    def _begin(self, start: EpisodeStart) -> VlaEvalSession:
        session, hello = wire.with_retries(self._open)
        with wire.closed_on_error(session):
            if spec_of(self._name, hello, self._options) != self.spec:
                message = f"{self._name}: another server answers than at the beginning of the run"
                raise PolicyError(message, cause="protocol")
            session.send("episode_start", {"task": _task(start)})
        return session

    def _open(self) -> tuple[VlaEvalSession, Hello]:
        session = VlaEvalSession(self._connect(self._url, self._timeout), self._msgpack, self._message)
        with wire.closed_on_error(session):
            greeting = session.receive("hello", session.send("hello", GREETING))
            hello = wire.validated(Hello, self._url, "hello", greeting)
            if hello.protocol_version != PROTOCOL_VERSION:
                version = f"version {hello.protocol_version} of the protocol, not {PROTOCOL_VERSION}"
                hint = "install a vla-eval there that speaks it, such as 0.8.0"
                raise wire.failure(self._url, f"it speaks {version}", "protocol", hint)
        return session, hello

    def _message(self, seen: Observation) -> dict[str, Any]:
        return self._messages(seen)


class VlaEvalSession:
    """A ``Session`` at such a server, with numbered messages."""

    def __init__(self, socket: Any, msgpack: Any, message: Callable[[Observation], dict[str, Any]]) -> None:
        self._socket, self._msgpack, self._message = socket, msgpack, message
        self._number, self._pending = 0, deque[int]()
        self.close = socket.close

    def ask(self, seen: Observation) -> None:
        self._pending.append(self.send("observation", self._message(seen)))

    def answer(self, wait: float) -> NDArray[np.float64]:
        return wire.actions_of(self.receive("action", self._pending.popleft(), wait))

    def end(self) -> None:
        """Send no metrics, since we judge the rollout ourselves."""
        self.send("episode_end", {"metrics": {}})

    def send(self, kind: str, payload: Mapping[str, Any]) -> int:
        """Send a message; returns its number, which the reply must repeat."""
        self._number += 1
        self._socket.send(self._msgpack.pack_vla_eval(kind, payload, self._number))
        return self._number

    def receive(self, kind: str, number: int, wait: float | None = None) -> Mapping[str, Any]:
        """The reply to message ``number``; PolicyError when it is late, an error, or another message."""
        url, frame = self._socket.url, self._socket.receive(wait)
        try:
            received, payload, echoed = self._msgpack.unpack_vla_eval(frame)
        except ValueError as error:
            raise wire.failure(url, f"not a vla-eval message: {error}", "protocol") from None
        if received == "error":
            raise wire.failure(url, wire.short(payload.get("error")), "remote")
        if (received, echoed) != (kind, number):
            problem = f"expected the message {kind!r} with number {number}, got {received!r} with {echoed!r}"
            raise wire.failure(url, problem, "protocol")
        return payload  # type: ignore[no-any-return]


class Messages:
    """Observations as a server is sent them: servers identify pictures by their order or by their names."""

    def __init__(self, name: str, hello: Hello, options: VlaEvalOptions) -> None:
        self._names = picture_names(spec_of(name, hello, options), options)
        self._layout = LAYOUTS.get(layout_of(name, hello, options) or "")
        self._short = wants_short_turns(hello, options)

    def __call__(self, seen: Observation) -> dict[str, Any]:
        message: dict[str, Any] = {
            "images": {name: seen.images[camera] for camera, name in self._names.items()},
            "task_description": seen.instruction,
        }
        if self._layout is not None and seen.state is not None:
            state = sent(self._layout, seen)
            if self._short:
                state[3:6] = Rotation.from_rotvec(state[3:6]).as_rotvec()
            message |= {"state": state, "states": state}  # servers read either of the two
        return message


def _task(start: EpisodeStart) -> dict[str, Any]:
    suite, _, number = start.task.rpartition("/")  # of LIBERO; some servers have settings for each suite
    place = {"suite": suite, "task_id": int(number)} if suite else {"suite": "vlafuzz"}
    task = {"name": start.instruction, "task": start.task}
    return task | place | {"episode": start.episode, "seed": start.seed}
