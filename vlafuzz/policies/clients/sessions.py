"""Rollouts at a model server, with a session each: its own connection, written and read by one protocol."""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.servers import Address, needed
from vlafuzz.policies.harness import check_chunks


class Session(ABC):
    """One rollout at a server. All methods but ``close`` may raise PolicyError."""

    model: Model  # once a rollout begins

    def __init__(self, connection: Any) -> None:
        self._connection, self._unanswered = connection, deque[Any]()
        self.close = connection.close

    @abstractmethod
    def ask(self, seen: Observation) -> None:
        """Send an observation."""

    @abstractmethod
    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions for the first unanswered observation; ValueError when the reply has no valid ones."""

    def end(self) -> None:  # noqa: B027 - most protocols cannot express it
        """Tell the server that the rollout is over, if the protocol can express it."""


class Sessions(ABC):
    """A policy with one session per live rollout. A rollout cannot continue after its session broke."""

    server: ClassVar[str]  # in messages
    start_it: ClassVar[str]  # how to start one
    packages: ClassVar[tuple[str, ...]] = ()  # optional ones that it needs

    def __init__(self, address: Address) -> None:
        self._name, self._url, self._options = address.name, address.url, address.options
        self._live: dict[str, tuple[EpisodeStart, Session]] = {}
        self._kept: dict[tuple[str, int], ActionChunk | PolicyError] = {}  # by rollout and step
        with needed(self._name, *self.packages), wire.required(self.server, f"start it first: {self.start_it}"):
            first = wire.with_retries(lambda: self._open(None))
        first.close()
        self._model = self._described(first)
        self.spec = self._model.spec

    @abstractmethod
    def _open(self, start: EpisodeStart | None) -> Session:
        """A session of a rollout, or of none, to see whether a server is there."""

    def _described(self, first: Any) -> Model:
        return Model(self._name, self._options)

    def _begin(self, start: EpisodeStart) -> Any:
        session = wire.with_retries(lambda: self._open(start))
        session.model = self._model
        return session

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        names = [start.episode for start in episodes]
        self._drop(names)
        try:
            for start in episodes:
                self._live[start.episode] = (start, self._begin(start))
        except BaseException:
            self._drop(names)
            raise

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """Send all observations, then receive all replies, so that the server can batch.

        When one of several fails, this raises and keeps the answers: to the same observations one by one, it gives
        those, since the servers have advanced the rollouts.
        """
        keys = [(seen.episode, seen.step) for seen in observations]
        self._exchange([seen for seen, key in zip(observations, keys, strict=True) if key not in self._kept])
        answers = [self._kept[key] for key in keys]
        errors = [answer for answer in answers if isinstance(answer, PolicyError)]
        if not errors or len(keys) == 1:
            self._kept = {key: answer for key, answer in self._kept.items() if key not in keys}
        if errors:
            raise errors[0]
        return cast(list[ActionChunk], answers)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Tell the server, and close the connections of these rollouts."""
        for start in episodes:
            begun, session = self._live.get(start.episode, (None, None))
            if session and begun is start:  # else another rollout has begun under that name
                with suppress(PolicyError):  # the rollout is over in any case
                    session.end()
                self._drop([start.episode])

    def close(self) -> None:
        self.finish([start for start, _ in self._live.values()])

    def _exchange(self, observations: Sequence[Observation]) -> None:
        """Keep each answer, or why there is none: then the session is closed."""
        try:
            asked = [(seen, self._ask(seen)) for seen in observations]
            until = time.monotonic() + self._options.timeout * len(asked)
            answers = [(seen, self._receive(seen, session, until)) for seen, session in asked]
        except BaseException:  # the sessions may hold replies that nobody will read
            self._drop([seen.episode for seen in observations])
            raise
        self._kept |= {(seen.episode, seen.step): answer for seen, answer in answers}

    def _ask(self, seen: Observation) -> Session | PolicyError:
        if seen.episode not in self._live:
            return PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        _, session = self._live[seen.episode]
        try:
            session.ask(seen)
        except PolicyError as error:
            self._drop([seen.episode])
            return error
        return session

    def _receive(self, seen: Observation, session: Session | PolicyError, until: float) -> ActionChunk | PolicyError:
        if isinstance(session, PolicyError):
            return session
        try:
            with wire.read(self._name, "bad_action"):
                chunk = ActionChunk(session.answer(until - time.monotonic()))
            check_chunks([chunk], 1, self._name)
        except PolicyError as error:
            self._drop([seen.episode])
            return error
        return chunk

    def _drop(self, episodes: Sequence[str]) -> None:
        self._kept = {key: answer for key, answer in self._kept.items() if key[0] not in episodes}
        for episode in episodes:
            if episode in self._live:
                self._live.pop(episode)[1].close()
