"""Recorder: keeps a policy's observations, answers and errors."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import (
    ActionChunk,
    EpisodeStart,
    Finishing,
    Knowing,
    Observation,
    Policy,
    PolicySpec,
)
from vlafuzz.policies.harness import blamed_on, check_chunks


class Lent:
    """Forwards everything to a policy, which stays open when this wrapper is closed."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def spec(self) -> PolicySpec:
        return self._policy.spec

    def know(self, catalogue: Any) -> None:
        if isinstance(self._policy, Knowing):
            self._policy.know(catalogue)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._policy.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        return self._policy.act(observations)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        if isinstance(self._policy, Finishing):
            self._policy.finish(episodes)

    def close(self) -> None:
        """Nothing: the owner closes the policy."""


@dataclass(frozen=True, eq=False)
class Moment:
    """An observation of a rollout, and the executed part of its answer: ``(steps, 7)``, units of the spec."""

    start: EpisodeStart
    seen: Observation
    executed: NDArray[np.float64]


class Break(NamedTuple):
    """An error of the policy. ``where``: when it happened, as an adverbial for messages."""

    where: str
    error: PolicyError


class Recorder(Lent):
    """Records a policy that drives one rollout at a time.

    Attributes:
        most: number of answers after which a rollout is cut off, and which are kept as ``moments``; None for
            complete rollouts, of which no moments are kept.
        breaks: the breaks of all rollouts; ``broken``: that of the last rollout, which may be restarted.
        seconds: duration of each answer; ``between``: from each to the next one of its rollout.
        longest: the number of actions in the longest chunk.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy)
        self.most: int | None = None
        self.moments: list[Moment] = []
        self.breaks: list[Break] = []
        self.broken: Break | None = None
        self.seconds: list[float] = []
        self.between: list[float] = []
        self.longest = 1
        self._start: EpisodeStart | None = None
        self._answers = 0
        self._ended = 0.0

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        (self._start,), self._answers, self.broken = episodes, 0, None
        with self._noted():
            super().reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        assert self._start is not None
        if self._answers == self.most:
            raise PolicyError("enough was seen of this rollout")  # makes the evaluator end it
        began = time.perf_counter()
        if self._answers:
            self.between.append(began - self._ended)
        with self._noted():
            chunks = super().act(observations)
            (answer,) = check_chunks(chunks, 1, self.spec.name, self.spec.action.width)
        self._ended = time.perf_counter()
        self.seconds.append(self._ended - began)
        self._answers += 1
        self.longest = max(self.longest, len(answer))
        if self.most is not None:
            self.moments.append(Moment(self._start, observations[0], answer[: self.spec.execute]))
        return chunks

    @contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            with blamed_on(self.spec.name):
                yield
        except PolicyError as error:
            self.broken = Break(f"after {self._answers} answers of a rollout", error)
            self.breaks.append(self.broken)
            raise
