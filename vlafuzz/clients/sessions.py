"""Rollouts at a model server: a session each, asked together, and broken together."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.harness import check_chunks


class Session(Protocol):
    """One rollout at a server, on a connection of its own. All but ``close`` raise PolicyError."""

    def ask(self, seen: Observation) -> None:
        """Send an observation."""

    def answer(self, wait: float) -> NDArray[np.float64]:
        """The actions for the first observation that has none yet; ValueError when they are none."""

    def end(self) -> None:
        """Tell the server that the rollout is over, where the protocol has a word for it."""

    def close(self) -> None:
        """Let go of the connection; it may be broken already."""


class Sessions(ABC):
    """A policy by its live rollouts. When a session breaks, its rollout cannot be gone on with.

    ``timeout`` in seconds is for one reply.
    """

    def __init__(self, name: str, timeout: float) -> None:
        self._name, self._timeout = name, timeout
        self._live: dict[str, tuple[EpisodeStart, Session]] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Open a session for each."""
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
            until = time.monotonic() + self._timeout * len(asked)
            chunks = [self._answer(session, until) for session in asked]
            check_chunks(chunks, len(asked), self._name)
        except BaseException:  # replies may be under way that nobody will fetch
            self._drop([seen.episode for seen in observations])
            raise
        return chunks

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Tell the server, and close their connections."""
        for start in episodes:
            begun, session = self._live.get(start.episode, (None, None))
            if session and begun is start:  # else it has begun anew under that name
                with suppress(PolicyError):  # over is over
                    session.end()
                self._drop([start.episode])

    def close(self) -> None:
        """No more rollouts."""
        self.finish([start for start, _ in self._live.values()])

    @abstractmethod
    def _begin(self, start: EpisodeStart) -> Session:
        """Open a session, on a connection of its own."""

    def _ask(self, seen: Observation) -> Session:
        if seen.episode not in self._live:
            raise PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        _, session = self._live[seen.episode]
        session.ask(seen)
        return session

    def _answer(self, session: Session, until: float) -> ActionChunk:
        try:
            return ActionChunk(session.answer(until - time.monotonic()))
        except ValueError as error:
            raise PolicyError(f"{self._name}: {error}", cause="bad_action") from None

    def _drop(self, episodes: Sequence[str]) -> None:
        for episode in episodes:
            if episode in self._live:
                self._live.pop(episode)[1].close()
