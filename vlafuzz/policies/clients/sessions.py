"""Policies at a model server with a connection for each rollout."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, TypeVar

from vlafuzz.common.arrays import Array
from vlafuzz.common.files import closed_on_error
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.servers import Address, needed
from vlafuzz.policies.clients.wire import HttpConnection, WebSocketConnection
from vlafuzz.policies.harness import answered, check_chunks

T = TypeVar("T")


@dataclass(eq=False)
class Session:
    """A connection with its rollout. ``greeting``: what the server says first; ``sent``: messages so far."""

    connection: Any
    start: EpisodeStart | None  # None: to see whether a server is there
    greeting: Any = None
    sent: int = 0


class Sessions(ABC):
    """A policy with one session per live rollout. A rollout cannot continue after its session broke.

    What subclasses implement may raise PolicyError.
    """

    server: ClassVar[str]  # in messages
    start_it: ClassVar[str]  # how to start one
    packages: ClassVar[tuple[str, ...]] = ()  # optional ones that it needs
    connection: ClassVar[type[HttpConnection | WebSocketConnection]]

    def __init__(self, address: Address) -> None:
        self._name, self._url, self._options = address.name, address.url, address.options
        self._live: dict[str, Session] = {}
        with needed(self._name, *self.packages), wire.required(self.server, f"start it first: {self.start_it}"):
            first = wire.with_retries(self._open)
        first.connection.close()
        self._model = self._described(first)
        self.spec = self._model.spec

    def _greet(self, session: Session) -> Any:  # noqa: B027
        """Exchange greetings; what the server says of itself."""

    def _described(self, first: Session) -> Model:
        return Model(self._name, self._options)

    def _begin(self, session: Session) -> None:  # noqa: B027
        """Tell the server that the rollout begins, if the protocol can express it."""

    @abstractmethod
    def _send(self, session: Session, seen: Observation) -> None:
        """Send an observation."""

    @abstractmethod
    def _receive(self, session: Session, seen: Observation, wait: float) -> Array:
        """The actions for the observation that was sent; ValueError when the reply has no valid ones."""

    def _end(self, session: Session) -> None:  # noqa: B027
        """Tell the server that the rollout is over, if the protocol can express it."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        names = [start.episode for start in episodes]
        self._drop(names)
        try:
            for start in episodes:
                self._live[start.episode] = wire.with_retries(partial(self._open, start))
                self._begin(self._live[start.episode])
        except BaseException:
            self._drop(names)
            raise

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """Send all observations, then receive all replies, so that the server can batch; see ``answered``."""
        try:
            errors = [self._tried(self._send, seen) for seen in observations]
            receive = partial(self._answer, time.monotonic() + self._options.timeout * len(observations))
            pairs = zip(errors, observations, strict=True)
            answers = [error if error else self._tried(receive, seen) for error, seen in pairs]
        except BaseException:  # the sessions may hold replies that nobody will read
            self._drop([seen.episode for seen in observations])
            raise
        return answered(answers)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Tell the server, and close the connections of these rollouts."""
        for start in episodes:
            session = self._live.get(start.episode)
            if session and session.start is start:  # else another rollout has begun under that name
                with suppress(PolicyError):  # the rollout is over in any case
                    self._end(session)
                self._drop([start.episode])

    def close(self) -> None:
        self.finish([session.start for session in self._live.values() if session.start])

    def _open(self, start: EpisodeStart | None = None) -> Session:
        session = Session(self.connection(self._url, self._options.timeout), start)
        with closed_on_error(session.connection):
            session.greeting = self._greet(session)
        return session

    def _answer(self, until: float, session: Session, seen: Observation) -> ActionChunk:
        chunk = ActionChunk(self._model.checked(self._receive(session, seen, until - time.monotonic())))
        return check_chunks([chunk], 1, self._name)[0]

    def _tried(self, step: Callable[[Session, Observation], T], seen: Observation) -> T | PolicyError:
        """The result of a step of a live rollout, or the error that it raised, after which its connection is closed."""
        if seen.episode not in self._live:
            return PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        try:
            with wire.read(self._name, "bad_action"):
                return step(self._live[seen.episode], seen)
        except PolicyError as error:
            self._drop([seen.episode])
            return error

    def _drop(self, episodes: Sequence[str]) -> None:
        for session in [self._live.pop(episode) for episode in episodes if episode in self._live]:
            session.connection.close()
