"""Rollouts at a model server, with one session each. Simultaneous requests succeed or fail together."""

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.remote import Address
from vlafuzz.clients.wire import bad_action
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.harness import check_chunks


class Session(Protocol):
    """One rollout at a server, on its own connection. All methods but ``close`` may raise PolicyError."""

    def ask(self, seen: Observation) -> None:
        """Send an observation."""

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions for the first unanswered observation; ValueError when the reply has no valid ones."""

    def end(self) -> None:
        """Tell the server that the rollout is over, if the protocol can express it."""

    def close(self) -> None:
        """Close the connection, which may be broken already."""


class Sessions(ABC):
    """A policy with one session per live rollout. A rollout cannot continue after its session broke."""

    def __init__(self, address: Address[Any]) -> None:
        self._name, self._url, self._timeout = address.name, address.url, address.options.timeout
        self._live: dict[str, tuple[EpisodeStart, Session]] = {}

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
        """Send all observations, then receive all replies, so that the server can batch."""
        try:
            sessions = [self._ask(seen) for seen in observations]
            until = time.monotonic() + self._timeout * len(sessions)
            with bad_action(self._name):
                chunks = [ActionChunk(session.answer(until - time.monotonic())) for session in sessions]
            check_chunks(chunks, len(sessions), self._name)
        except BaseException:  # the other sessions may hold replies that nobody will read
            self._drop([seen.episode for seen in observations])
            raise
        return chunks

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

    @abstractmethod
    def _begin(self, start: EpisodeStart) -> Session: ...

    def _ask(self, seen: Observation) -> Session:
        if seen.episode not in self._live:
            raise PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        _, session = self._live[seen.episode]
        session.ask(seen)
        return session

    def _drop(self, episodes: Sequence[str]) -> None:
        for episode in episodes:
            if episode in self._live:
                self._live.pop(episode)[1].close()
