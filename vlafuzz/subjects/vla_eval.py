"""VlaEval: a model behind a server of vla-eval's protocol."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import ValidationError

from vlafuzz import __version__
from vlafuzz.errors import PrerequisiteError, SubjectError
from vlafuzz.subjects.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.subjects.harness import check_chunks
from vlafuzz.subjects.remote import INSTALL, Address
from vlafuzz.subjects.vla_eval_spec import LAYOUTS, Hello, layout_of, spec_of

if TYPE_CHECKING:
    from vlafuzz.subjects.vla_eval_wire import Connection

PROTOCOL_VERSION = 1
GREETING = {"harness_version": f"vlafuzz {__version__}", "protocol_version": PROTOCOL_VERSION}


class VlaEval:
    """A model behind a vla-eval server; options come after a question mark: ?camera=256&wrist=1.

    A live rollout has a connection of its own, since servers keep chunks of actions for each. When it breaks,
    the rollout cannot be gone on with. So it is not ``shared``: the server already puts observations together
    that arrive on several connections, and workers that ask it themselves save a way.
    """

    form: ClassVar[str] = "vla-eval:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")

    def __init__(self, address: Address) -> None:
        try:
            from vlafuzz.subjects import vla_eval_wire
        except ModuleNotFoundError as error:
            raise PrerequisiteError(
                f"{address.name} needs the package {error.name!r}", hint=INSTALL
            ) from None
        self._address, self._wire = address, vla_eval_wire
        self._live: dict[str, tuple[EpisodeStart, Connection]] = {}
        connection, hello = self._greet()
        connection.close()
        self._state = layout_of(address.name, hello, address.options)
        self.spec = spec_of(address.name, hello, address.options)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Open a connection for each."""
        names = [start.episode for start in episodes]
        self._drop(names)
        try:
            for start in episodes:
                self._live[start.episode] = (start, self._begin(start))
        except BaseException:
            self._drop(names)
            raise

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """Send all, then receive all, so that a server can batch. They break together."""
        try:
            asked = [self._ask(seen) for seen in observations]
            until = time.monotonic() + self._address.options.timeout * len(asked)
            chunks = [self._answer(connection, number, until) for connection, number in asked]
            check_chunks(chunks, len(asked), self.spec.name)
        except BaseException:  # replies may be under way that nobody will fetch
            self._drop([seen.episode for seen in observations])
            raise
        return chunks

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Tell the server, and close their connections."""
        for start in episodes:
            begun, connection = self._live.get(start.episode, (None, None))
            if connection and begun is start:  # else it has begun anew under that name
                with suppress(SubjectError):  # over is over
                    connection.send("episode_end", {"metrics": {}})
                self._drop([start.episode])

    def close(self) -> None:
        """No more rollouts."""
        self.finish([start for start, _ in self._live.values()])

    def _begin(self, start: EpisodeStart) -> Connection:
        connection, hello = self._open()
        try:
            if spec_of(self._address.name, hello, self._address.options) != self.spec:
                told = f"{self._address.name}: another server answers than at the beginning of the run"
                raise SubjectError(told, cause="protocol")
            connection.send("episode_start", {"task": _task(start)})
        except BaseException:
            connection.close()
            raise
        return connection

    def _greet(self) -> tuple[Connection, Hello]:
        """The first session: no server now means that there is none to test."""
        try:
            return self._open()
        except SubjectError as error:
            raise PrerequisiteError(
                f"no vla-eval server: {error.message}",
                hint=error.hint or "start it first: vla-eval serve --config …",
            ) from None

    def _open(self) -> tuple[Connection, Hello]:
        url, timeout = self._address.url, self._address.options.timeout
        connection, payload = self._wire.open_session(url, timeout, GREETING)
        try:
            hello = Hello.model_validate(payload)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(step) for step in first["loc"])
            connection.close()
            raise SubjectError(f"{url}: its hello: {where}: {first['msg']}", cause="protocol") from None
        if hello.protocol_version != PROTOCOL_VERSION:
            connection.close()
            raise SubjectError(
                f"{url}: it speaks version {hello.protocol_version} of the protocol, not {PROTOCOL_VERSION}",
                hint="install a vla-eval there that speaks it, such as 0.8.0",
                cause="protocol",
            )
        return connection, hello

    def _ask(self, seen: Observation) -> tuple[Connection, int]:
        if seen.episode not in self._live:
            raise SubjectError(f"{self.spec.name}: no live rollout {seen.episode!r}", cause="protocol")
        _, connection = self._live[seen.episode]
        message: dict[str, Any] = {
            "images": {camera.name: seen.images[camera.name] for camera in self.spec.cameras},
            "task_description": seen.instruction,
        }
        if self._state is not None and seen.state is not None:
            state = LAYOUTS[self._state](seen.state)
            message |= {"state": state, "states": state}  # servers read the one or the other
        return connection, connection.send("observation", message)

    def _answer(self, connection: Connection, number: int, until: float) -> ActionChunk:
        payload = connection.receive("action", number, until - time.monotonic())
        try:
            return ActionChunk(self._wire.actions_of(payload))
        except ValueError as error:
            raise SubjectError(f"{self.spec.name}: {error}", cause="bad_action") from None

    def _drop(self, episodes: Sequence[str]) -> None:
        for episode in episodes:
            if episode in self._live:
                self._live.pop(episode)[1].close()


def _task(start: EpisodeStart) -> Mapping[str, Any]:
    return {
        "name": start.instruction,
        "suite": "vlafuzz",
        "task": start.task,
        "episode": start.episode,
        "seed": start.seed,
    }
