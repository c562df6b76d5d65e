"""Recorder: keeps what a subject is shown and answers, and how it breaks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import Cause, SubjectError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.subjects.base import (
    ActionChunk,
    EpisodeStart,
    Finishing,
    Knowing,
    Observation,
    Subject,
    SubjectSpec,
)
from vlafuzz.subjects.harness import blamed_on, check_chunks


class Lent:
    """Passes everything on to a subject, which stays open when this is closed."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject

    @property
    def spec(self) -> SubjectSpec:
        """The subject's own."""
        return self._subject.spec

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``."""
        if isinstance(self._subject, Knowing):
            self._subject.know(catalogue)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Subject``."""
        self._subject.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """See ``Subject``."""
        return self._subject.act(observations)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Finishing``."""
        if isinstance(self._subject, Finishing):
            self._subject.finish(episodes)

    def close(self) -> None:
        """Nothing: it is only lent."""


@dataclass(frozen=True, eq=False)
class Moment:
    """What the subject was shown at a moment of a rollout.

    ``executed``: of its answer, ``(steps, 7)`` in the units of the spec.
    """

    start: EpisodeStart
    seen: Observation
    executed: NDArray[np.float64]


@dataclass(frozen=True)
class Break:
    """The subject broke, ``where`` says when."""

    where: str
    cause: Cause
    message: str
    hint: str | None

    @staticmethod
    def of(error: SubjectError, where: str) -> Break:
        """As the subject told it."""
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

    def __init__(self, subject: Subject) -> None:
        super().__init__(subject)
        self.most: int | None = None
        self.moments: list[Moment] = []
        self.breaks: list[Break] = []
        self.broken: Break | None = None
        self.seconds: list[float] = []
        self.longest = 1
        self._start: EpisodeStart | None = None
        self._answers = 0

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """See ``Subject``."""
        (self._start,), self._answers, self.broken = episodes, 0, None
        try:
            with blamed_on(self.spec.name):
                super().reset(episodes)
        except SubjectError as error:
            self._note(error)
            raise

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """See ``Subject``."""
        assert self._start is not None
        if self._answers == self.most:
            raise SubjectError("enough was seen of this rollout")  # which ends it, as the evaluator has it
        began = time.perf_counter()
        try:
            with blamed_on(self.spec.name):
                chunks = super().act(observations)
                (answer,) = check_chunks(chunks, 1, self.spec.name)
        except SubjectError as error:
            self._note(error)
            raise
        self.seconds.append(time.perf_counter() - began)
        self._answers += 1
        self.longest = max(self.longest, len(answer))
        if self.most is not None:
            self.moments.append(Moment(self._start, observations[0], answer[: self.spec.execute]))
        return chunks

    def _note(self, error: SubjectError) -> None:
        self.broken = Break.of(error, f"after {self._answers} answers of a rollout")
        self.breaks.append(self.broken)
