"""Service: one subject for many callers. What they ask for at the same time, it is asked together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from vlafuzz.errors import SubjectError
from vlafuzz.subjects.base import ActionChunk, EpisodeStart, Finishing, Observation, Subject
from vlafuzz.subjects.harness import blamed_on, check_chunks


@dataclass(frozen=True, eq=False)
class Asked:
    """What a worker's subject is asked for, and which of its rollouts are over.

    Episodes have names that the caller gives once only.
    """

    begin: Sequence[EpisodeStart] = ()
    act: Sequence[Observation] = ()
    over: Sequence[str] = ()


Answer = list[ActionChunk] | SubjectError  # chunks for all of ``act``


class Service:
    """Answers callers, each known by a number, as the subject alone would have answered each of them."""

    def __init__(self, subject: Subject) -> None:
        self._subject, self._name = subject, subject.spec.name
        self._live: dict[str, EpisodeStart] = {}

    def answer(self, asked: Sequence[tuple[int, Asked]]) -> list[Answer]:
        """One answer each, in order. All observations go to the subject together, ``max_batch`` at most."""
        begun = [self._begin(caller, each) for caller, each in asked]
        seen = [
            replace(observation, episode=_own(caller, observation.episode))
            for (caller, each), error in zip(asked, begun, strict=True)
            for observation in ([] if error else each.act)
        ]
        most = max(self._subject.spec.max_batch, 1)
        groups = [seen[first : first + most] for first in range(0, len(seen), most)]
        found = iter([chunk for group in groups for chunk in self._act(group)])
        return [
            error or _together(list(islice(found, len(each.act))))
            for (_, each), error in zip(asked, begun, strict=True)
        ]

    def leave(self, caller: int) -> None:
        """A caller is gone, and its rollouts with it."""
        self._finish([name for name in self._live if name.startswith(_own(caller, ""))])

    def _begin(self, caller: int, asked: Asked) -> SubjectError | None:
        self._finish([_own(caller, name) for name in asked.over])
        if not asked.begin:
            return None
        starts = [replace(start, episode=_own(caller, start.episode)) for start in asked.begin]
        try:
            with blamed_on(self._name):
                self._subject.reset(starts)
        except SubjectError as error:
            return _plain(error)
        self._live |= {start.episode: start for start in starts}
        return None

    def _act(self, seen: Sequence[Observation]) -> Sequence[ActionChunk | SubjectError]:
        try:
            with blamed_on(self._name):
                chunks = check_chunks(self._subject.act(seen), len(seen), self._name)
        except SubjectError as error:
            if len(seen) == 1:
                return [_plain(error)]
            return [chunk for each in seen for chunk in self._act([each])]  # it is not to cost the others
        return [ActionChunk(chunk) for chunk in chunks]

    def _finish(self, names: Sequence[str]) -> None:
        over = [self._live.pop(name) for name in names if name in self._live]
        if over and isinstance(self._subject, Finishing):
            self._subject.finish(over)


def _own(caller: int, episode: str) -> str:
    """An episode's name among those of all callers."""
    return f"{caller}/{episode}"


def _together(chunks: Sequence[ActionChunk | SubjectError]) -> Answer:
    """The chunks, or the first error among them."""
    errors = [each for each in chunks if isinstance(each, SubjectError)]
    return errors[0] if errors else [each for each in chunks if not isinstance(each, SubjectError)]


def _plain(error: SubjectError) -> SubjectError:
    """Without its history and without a class of the subject's own: it has to go through a pipe."""
    return SubjectError(error.message, error.hint, error.cause)
