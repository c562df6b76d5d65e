"""Batching policy: one policy for many callers, whose simultaneous requests it answers in one call."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.harness import PartlyAnsweredError, blamed_on, check_chunks, finish


@dataclass(frozen=True, eq=False)
class Request:
    """A caller's request, which never uses the name of an episode twice. ``over``: rollouts to end."""

    begin: Sequence[EpisodeStart] = ()
    act: Sequence[Observation] = ()
    over: Sequence[str] = ()


Answer = list[ActionChunk] | PolicyError  # one chunk per observation of ``Request.act``


class StandIn(ABC):
    """A caller's ``Policy``, whose requests somebody has answered by a ``BatchingPolicy``."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec
        self._number = 0
        self._live: list[tuple[EpisodeStart, str]] = []  # with the name of the rollout in requests
        self._over: list[str] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        first, self._number = self._number, self._number + len(episodes)
        begun = [(start, f"{number}/{start.episode}") for number, start in enumerate(episodes, first)]
        self._answer(self._request(begin=[replace(start, episode=name) for start, name in begun]))
        self._live += begun

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return self._answer(self.request(observations))

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Sent with the next request: garbage collection may call this in the middle of one."""
        self._over += [name for start, name in self._live if any(start is ended for ended in episodes)]
        self._live = [(start, name) for start, name in self._live if name not in self._over]

    def request(self, observations: Sequence[Observation]) -> Request:
        """The request with which the policy is to act."""
        names = {start.episode: name for start, name in self._live}
        return self._request(
            act=[replace(seen, episode=names.get(seen.episode, seen.episode)) for seen in observations]
        )

    def _request(self, *, begin: Sequence[EpisodeStart] = (), act: Sequence[Observation] = ()) -> Request:
        over, self._over = self._over, []
        return Request(begin, act, over)

    @abstractmethod
    def _answer(self, request: Request) -> list[ActionChunk]:
        """The answer to a request; what is a PolicyError is raised."""


class BatchingPolicy:
    """Gives every caller, identified by a number, the answers that the policy would give to it alone."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._name = policy, policy.spec.name
        self._live: dict[str, EpisodeStart] = {}

    def answer(self, requests: Sequence[tuple[int, Request]]) -> list[Answer]:
        """One answer per request, in order. Observations go to the policy in batches of ``max_batch``."""
        errors = [self._begin(caller, request) for caller, request in requests]
        observations = [
            replace(observation, episode=_own(caller, observation.episode))
            for (caller, request), error in zip(requests, errors, strict=True)
            for observation in ([] if error else request.act)
        ]
        size = self._policy.spec.max_batch
        chunks: list[ActionChunk | PolicyError] = []
        for first in range(0, len(observations), size):
            chunks += self._act(observations[first : first + size])
        answers: list[Answer] = []
        for (_, request), error in zip(requests, errors, strict=True):
            count = 0 if error else len(request.act)
            mine, chunks = chunks[:count], chunks[count:]
            broken = next((chunk for chunk in mine if isinstance(chunk, PolicyError)), error)
            answers.append(broken or cast(list[ActionChunk], mine))
        return answers

    def leave(self, caller: int) -> None:
        """End all rollouts of a caller that is gone."""
        self._finish([name for name in self._live if name.startswith(_own(caller, ""))])

    def _begin(self, caller: int, request: Request) -> PolicyError | None:
        self._finish([_own(caller, name) for name in request.over])
        if not request.begin:
            return None
        starts = [replace(start, episode=_own(caller, start.episode)) for start in request.begin]
        try:
            with blamed_on(self._name):
                self._policy.reset(starts)
        except PolicyError as error:
            return _plain(error)
        self._live |= {start.episode: start for start in starts}
        return None

    def _act(self, batch: Sequence[Observation]) -> Sequence[ActionChunk | PolicyError]:
        try:
            with blamed_on(self._name):
                width = self._policy.spec.action.width
                return check_chunks(self._policy.act(batch), len(batch), self._name, width)
        except PartlyAnsweredError as partly:
            return [_plain(answer) if isinstance(answer, PolicyError) else answer for answer in partly.answers]
        except PolicyError as error:
            if len(batch) == 1:
                return [_plain(error)]
            # One observation's error must not cost the others their answers.
            return [chunk for observation in batch for chunk in self._act([observation])]

    def _finish(self, names: Sequence[str]) -> None:
        finish(self._policy, [self._live.pop(name) for name in names if name in self._live])


def _own(caller: int, episode: str) -> str:
    return f"{caller}/{episode}"


def _plain(error: PolicyError) -> PolicyError:
    """The error without its traceback and without the policy's own class: it must go through a pipe."""
    return PolicyError(error.message, error.hint, error.cause)
