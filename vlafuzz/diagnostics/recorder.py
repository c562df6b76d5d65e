"""Recorder: keeps what a policy is shown and answers, and how it breaks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import Cause, PolicyError
from vlafuzz.objects.catalogue import Catalogue
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
    """Passes everything on to a policy, which stays open when this is closed."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def spec(self) -> PolicySpec:
        """The policy's own."""
        return self._policy.spec

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``."""
        if isinstance(self._policy, Knowing):
            self._policy.know(catalogue)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Policy``."""
        self._policy.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """See ``Policy``."""
        return self._policy.act(observations)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Finishing``."""
        if isinstance(self._policy, Finishing):
            self._policy.finish(episodes)

    def close(self) -> None:
        """Nothing: it is only lent."""


@dataclass(frozen=True, eq=False)
class Moment:
    """What the policy was shown at a moment of a rollout.

    ``executed``: of its answer, ``(steps, 7)`` in the units of the spec.
    """

    start: EpisodeStart
    seen: Observation
    executed: NDArray[np.float64]


@dataclass(frozen=True)
class Break:
    """The policy broke, ``where`` says when."""

    where: str
    cause: Cause
    message: str
    hint: str | None

    @staticmethod
    def of(error: PolicyError, where: str) -> Break:
        """As the policy told it."""
        return Break(where, error.cause, error.message, error.hint)


class Recorder(Lent):
    """Drives one rollout at a time.

    Attributes:
        most: answers of a rollout, which are kept as ``moments``; after them it is cut off. None for no end,
            with nothing kept.
        breaks: of all rollouts; ``broken`` is that of the last one, which may have been begun again.
        seconds: that each answer took.
        longest: actions in a chunk.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy)
        self.most: int | None = None
        self.moments: list[Moment] = []
        self.breaks: list[Break] = []
        self.broken: Break | None = None
        self.seconds: list[float] = []
        self.longest = 1
        self._start: EpisodeStart | None = None
        self._answers = 0

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Policy``."""
        (self._start,), self._answers, self.broken = episodes, 0, None
        try:
            with blamed_on(self.spec.name):
                super().reset(episodes)
        except PolicyError as error:
            self._note(error)
            raise

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """See ``Policy``."""
        assert self._start is not None
        if self._answers == self.most:
            raise PolicyError("enough was seen of this rollout")  # which ends it, as the evaluator has it
        began = time.perf_counter()
        try:
            with blamed_on(self.spec.name):
                chunks = super().act(observations)
                (answer,) = check_chunks(chunks, 1, self.spec.name)
        except PolicyError as error:
            self._note(error)
            raise
        self.seconds.append(time.perf_counter() - began)
        self._answers += 1
        self.longest = max(self.longest, len(answer))
        if self.most is not None:
            self.moments.append(Moment(self._start, observations[0], answer[: self.spec.execute]))
        return chunks

    def _note(self, error: PolicyError) -> None:
        self.broken = Break.of(error, f"after {self._answers} answers of a rollout")
        self.breaks.append(self.broken)
