"""Service: one policy for many callers. What they ask for at the same time, it is asked together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Finishing, Observation, Policy
from vlafuzz.policies.harness import blamed_on, check_chunks


@dataclass(frozen=True, eq=False)
class Asked:
    """What a worker's policy is asked for, and which of its rollouts are over.

    Episodes have names that the caller gives once only.
    """

    begin: Sequence[EpisodeStart] = ()
    act: Sequence[Observation] = ()
    over: Sequence[str] = ()


Answer = list[ActionChunk] | PolicyError  # chunks for all of ``act``


class BatchingPolicy:
    """Answers callers, each known by a number, as the policy alone would have answered each of them."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._name = policy, policy.spec.name
        self._live: dict[str, EpisodeStart] = {}

    def answer(self, asked: Sequence[tuple[int, Asked]]) -> list[Answer]:
        """One answer each, in order. All observations go to the policy together, ``max_batch`` at most."""
        begun = [self._begin(caller, each) for caller, each in asked]
        seen = [
            replace(observation, episode=_own(caller, observation.episode))
            for (caller, each), error in zip(asked, begun, strict=True)
            for observation in ([] if error else each.act)
        ]
        most = max(self._policy.spec.max_batch, 1)
        groups = [seen[first : first + most] for first in range(0, len(seen), most)]
        found = iter([chunk for group in groups for chunk in self._act(group)])
        return [
            error or _together(list(islice(found, len(each.act))))
            for (_, each), error in zip(asked, begun, strict=True)
        ]

    def leave(self, caller: int) -> None:
        """A caller is gone, and its rollouts with it."""
        self._finish([name for name in self._live if name.startswith(_own(caller, ""))])

    def _begin(self, caller: int, asked: Asked) -> PolicyError | None:
        self._finish([_own(caller, name) for name in asked.over])
        if not asked.begin:
            return None
        starts = [replace(start, episode=_own(caller, start.episode)) for start in asked.begin]
        try:
            with blamed_on(self._name):
                self._policy.reset(starts)
        except PolicyError as error:
            return _plain(error)
        self._live |= {start.episode: start for start in starts}
        return None

    def _act(self, seen: Sequence[Observation]) -> Sequence[ActionChunk | PolicyError]:
        try:
            with blamed_on(self._name):
                chunks = check_chunks(self._policy.act(seen), len(seen), self._name)
        except PolicyError as error:
            if len(seen) == 1:
                return [_plain(error)]
            return [chunk for each in seen for chunk in self._act([each])]  # it is not to cost the others
        return [ActionChunk(chunk) for chunk in chunks]

    def _finish(self, names: Sequence[str]) -> None:
        over = [self._live.pop(name) for name in names if name in self._live]
        if over and isinstance(self._policy, Finishing):
            self._policy.finish(over)


def _own(caller: int, episode: str) -> str:
    """An episode's name among those of all callers."""
    return f"{caller}/{episode}"


def _together(chunks: Sequence[ActionChunk | PolicyError]) -> Answer:
    """The chunks, or the first error among them."""
    errors = [each for each in chunks if isinstance(each, PolicyError)]
    return errors[0] if errors else [each for each in chunks if not isinstance(each, PolicyError)]


def _plain(error: PolicyError) -> PolicyError:
    """Without its history and without a class of the policy's own: it has to go through a pipe."""
    return PolicyError(error.message, error.hint, error.cause)
