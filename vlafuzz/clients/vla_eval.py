"""Models behind servers of vla-eval's protocol."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from vlafuzz import __version__
from vlafuzz.clients.conventions import LAYOUTS, Layout
from vlafuzz.clients.remote import Address, CommonOptions, VlaEvalOptions, needed
from vlafuzz.clients.sessions import Sessions
from vlafuzz.clients.vla_eval_spec import Hello, layout_of, spec_of
from vlafuzz.clients.wire import actions_of, required
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import CameraRequest, EpisodeStart, Observation

if TYPE_CHECKING:
    from vlafuzz.clients.vla_eval_wire import Connection

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
    options: ClassVar[type[CommonOptions]] = VlaEvalOptions

    def __init__(self, address: Address[VlaEvalOptions]) -> None:
        super().__init__(address.name, address.options.timeout)
        with needed(address.name):
            from vlafuzz.clients import vla_eval_wire
        self._address, self._wire = address, vla_eval_wire
        with required("vla-eval", "start it first: vla-eval serve --config …"):
            connection, hello = self._open()
        connection.close()
        self._layout = LAYOUTS.get(layout_of(address.name, hello, address.options) or "")
        self.spec = spec_of(address.name, hello, address.options)

    def _begin(self, start: EpisodeStart) -> VlaEvalSession:
        connection, hello = self._open()
        try:
            if spec_of(self._address.name, hello, self._address.options) != self.spec:
                message = f"{self._address.name}: another server answers than at the beginning of the run"
                raise PolicyError(message, cause="protocol")
            connection.send("episode_start", {"task": _task(start)})
        except BaseException:
            connection.close()
            raise
        return VlaEvalSession(connection, self.spec.cameras, self._layout)

    def _open(self) -> tuple[Connection, Hello]:
        url, timeout = self._address.url, self._address.options.timeout
        connection, payload = self._wire.open_session(url, timeout, GREETING)
        try:
            hello = Hello.model_validate(payload)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(step) for step in first["loc"])
            connection.close()
            raise PolicyError(f"{url}: its hello: {where}: {first['msg']}", cause="protocol") from None
        if hello.protocol_version != PROTOCOL_VERSION:
            connection.close()
            raise PolicyError(
                f"{url}: it speaks version {hello.protocol_version} of the protocol, not {PROTOCOL_VERSION}",
                hint="install a vla-eval there that speaks it, such as 0.8.0",
                cause="protocol",
            )
        return connection, hello


class VlaEvalSession:
    """One rollout at such a server."""

    def __init__(
        self, connection: Connection, cameras: Sequence[CameraRequest], layout: Layout | None
    ) -> None:
        self._connection, self._cameras, self._layout = connection, cameras, layout
        self._pending: deque[int] = deque()
        self.close = connection.close

    def ask(self, seen: Observation) -> None:
        """Send it."""
        message = message_of(seen, self._cameras, self._layout)
        self._pending.append(self._connection.send("observation", message))

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions."""
        return actions_of(self._connection.receive("action", self._pending.popleft(), wait))

    def end(self) -> None:
        """Send no metrics, since we judge the rollout ourselves."""
        self._connection.send("episode_end", {"metrics": {}})


def message_of(seen: Observation, cameras: Sequence[CameraRequest], layout: Layout | None) -> dict[str, Any]:
    """The message with an observation. Servers identify pictures by their order, that of the cameras."""
    message: dict[str, Any] = {
        "images": {camera.name: seen.images[camera.name] for camera in cameras},
        "task_description": seen.instruction,
    }
    if layout is not None and seen.state is not None:
        state = layout(seen.state)
        message |= {"state": state, "states": state}  # servers read either of the two
    return message


def _task(start: EpisodeStart) -> Mapping[str, Any]:
    return {
        "name": start.instruction,
        "suite": "vlafuzz",
        "task": start.task,
        "episode": start.episode,
        "seed": start.seed,
    }
