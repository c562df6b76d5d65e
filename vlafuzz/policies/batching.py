"""Batching policy: one policy for many callers, whose simultaneous requests it answers in one call."""

import itertools
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import Condition, Lock
from typing import cast

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.harness import BlamedOn, PartlyAnsweredError, check_chunks, finish

# While there are rollouts without a pending request, requests wait for the next one: a tenth of the last answer's time
# and at most 5 ms, less than a simulator needs for a step and an image; after more than 0.1 s a twentieth of it.
WAIT, HURRY, PATIENCE = 0.005, 0.1, 0.05


def patience(took: float) -> float:
    """Seconds that requests wait for the next one, after an answer that took so long."""
    return max(min(WAIT, HURRY * took), PATIENCE * took)


@dataclass(frozen=True, eq=False)
class Request:
    """A caller's request. ``over``: rollouts to end; one that begins under the name of another ends that."""

    begin: Sequence[EpisodeStart] = ()
    act: Sequence[Observation] = ()
    over: Sequence[str] = ()


Answer = list[ActionChunk] | PolicyError  # one chunk per observation of ``Request.act``


class StandIn(ABC):
    """A caller's ``Policy``, whose requests somebody has answered by a ``BatchingPolicy``."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec
        self._live: dict[str, EpisodeStart] = {}
        self._over: list[str] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._live |= {start.episode: start for start in episodes}
        self._answer(self.request(begin=episodes))

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return self._answer(self.request(act=observations))

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Sent with the next request: garbage collection may call this in the middle of one."""
        ended = [start.episode for start in episodes if self._live.get(start.episode) is start]
        self._live = {name: start for name, start in self._live.items() if name not in ended}
        self._over += ended

    def request(self, *, begin: Sequence[EpisodeStart] = (), act: Sequence[Observation] = ()) -> Request:
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
        starts = [replace(start, episode=_own(caller, start.episode)) for start in request.begin]
        self._finish([*(_own(caller, name) for name in request.over), *(start.episode for start in starts)])
        if not starts:
            return None
        try:
            with BlamedOn(self._name):
                self._policy.reset(starts)
        except PolicyError as error:
            return _plain(error)
        self._live |= {start.episode: start for start in starts}
        return None

    def _act(self, batch: Sequence[Observation]) -> Sequence[ActionChunk | PolicyError]:
        try:
            with BlamedOn(self._name):
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


@dataclass(eq=False)
class _Pending:
    caller: int
    request: Request
    turn: Condition  # of each caller its own, so that an answer wakes that caller alone
    answer: Answer | None = None


class ServedPolicy:
    """One policy for many connections, each with a thread; it has no thread of its own.

    The first caller, while nobody else is being served, gathers the requests of the others for a while, has them
    answered, and distributes the answers. The next caller gathers what arrives meanwhile.

    Args:
        wait: the seconds that requests wait for the next one, after an answer that took so many.
        longest: seconds for an answer before SIGALRM ends the process, as one that hangs; 0 for no limit.
    """

    def __init__(self, policy: Policy, wait: Callable[[float], float] = patience, longest: float = 0.0) -> None:
        self.spec, self._longest, self.newcomers = policy.spec, longest, itertools.count()
        self._batching, self._most, self._wait = BatchingPolicy(policy), policy.spec.max_batch, wait
        self._busy, self._took, self._lock = False, 0.0, Lock()
        self._more, self._idle = Condition(self._lock), Condition(self._lock)
        self._pending: list[_Pending] = []
        self._live: set[int] = set()  # callers in the middle of a rollout, which will send requests

    def leave(self, caller: int) -> None:
        with self._lock:
            self._idle.wait_for(lambda: not self._busy)
            self._live.discard(caller)
            self._batching.leave(caller)

    def ask(self, caller: int, request: Request) -> Sequence[ActionChunk]:
        """One chunk per observation; blocks until they are there, and raises what the policy raised."""
        mine = _Pending(caller, request, Condition(self._lock))
        with self._lock:
            self._pending.append(mine)
            (self._live.add if request.begin or request.act else self._live.discard)(caller)
            self._more.notify()
        while True:
            with self._lock:
                mine.turn.wait_for(lambda: mine.answer is not None or not self._busy)
                if mine.answer is not None:
                    break
                self._busy = True
                while not self._complete() and self._more.wait(self._wait(self._took)):
                    pass  # another request has come
            self._answer_some()
        if isinstance(mine.answer, PolicyError):
            raise mine.answer
        return mine.answer

    def _complete(self) -> bool:
        """Whether there is no reason to wait for further requests."""
        acting = sum(bool(pending.request.act) for pending in self._pending)
        return not acting or acting >= min(self._most, len(self._live))

    def _answer_some(self) -> None:
        with self._lock:
            sizes = itertools.accumulate(len(pending.request.act) for pending in self._pending)
            count = max(sum(size <= self._most for size in sizes), 1)  # the others come with what arrives meanwhile
            batch, self._pending = self._pending[:count], self._pending[count:]
        answers: Sequence[Answer] = [PolicyError("the policy gave no answer")] * len(batch)
        began = time.monotonic()
        try:
            if self._longest:  # a timer of the system: one of faulthandler's would take a millisecond of every answer
                signal.setitimer(signal.ITIMER_REAL, self._longest)
            answers = self._batching.answer([(pending.caller, pending.request) for pending in batch])
        finally:  # whatever the policy raises, no caller may wait forever
            if self._longest:
                signal.setitimer(signal.ITIMER_REAL, 0)
            with self._lock:
                self._busy, self._took = False, time.monotonic() - began
                for pending, answer in zip(batch, answers, strict=True):
                    pending.answer = answer
                for pending in [*batch, *self._pending[:1]]:
                    pending.turn.notify()
                self._idle.notify_all()


def _own(caller: int, episode: str) -> str:
    return f"{caller}/{episode}"


def _plain(error: PolicyError) -> PolicyError:
    """The error without its traceback and without the policy's own class: it must go through a pipe."""
    return PolicyError(error.message, error.hint, error.cause)
