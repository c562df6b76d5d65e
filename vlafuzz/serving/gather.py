"""Request gatherer: answers nearly simultaneous requests of several connections in one call of the policy."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Condition

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, Policy
from vlafuzz.policies.batching import Answer, BatchingPolicy, Request

# Seconds that a request waits for others: less than a simulator needs for a step and an image, and only
# while there are rollouts without a pending request.
WAIT = 0.005


class _Pending:
    """A request and its answer, which is None until it arrives."""

    def __init__(self, caller: int, request: Request) -> None:
        self.caller, self.request = caller, request
        self.answer: Answer | None = None


class RequestGatherer:
    """One policy for many threads; it has no thread of its own.

    The first caller, while nobody else is being served, gathers the requests of the others for at most
    ``wait`` seconds, has all of them answered, and distributes the answers. Requests that arrive meanwhile
    are gathered by the next caller.
    """

    def __init__(self, policy: Policy, wait: float = WAIT) -> None:
        self._batching, self._most, self._wait = BatchingPolicy(policy), policy.spec.max_batch, wait
        self._changed, self._busy = Condition(), False
        self._pending: list[_Pending] = []
        self._live: set[int] = set()  # callers in the middle of a rollout, which will send requests

    def ask(self, caller: int, request: Request) -> Sequence[ActionChunk]:
        """One chunk per observation; blocks until they are there, and raises what the policy raised."""
        mine = _Pending(caller, request)
        with self._changed:
            self._pending.append(mine)
            (self._live.discard if request.over else self._live.add)(caller)
            self._changed.notify_all()
            self._changed.wait_for(lambda: mine.answer is not None or not self._busy)
            if mine.answer is None:
                self._busy = True
                self._changed.wait_for(self._complete, self._wait)
        if mine.answer is None:
            self._answer_all()
        assert mine.answer is not None
        if isinstance(mine.answer, PolicyError):
            raise mine.answer
        return mine.answer

    def _complete(self) -> bool:
        """Whether there is no reason to wait for further requests."""
        acting = sum(bool(pending.request.act) for pending in self._pending)
        return not acting or acting >= min(self._most, len(self._live))

    def _answer_all(self) -> None:
        with self._changed:
            batch, self._pending = self._pending, []
        answers: Sequence[Answer] = [PolicyError("the policy gave no answer")] * len(batch)
        try:
            answers = self._batching.answer([(pending.caller, pending.request) for pending in batch])
        finally:  # whatever the policy raises, no caller may wait forever
            with self._changed:
                for pending, answer in zip(batch, answers, strict=True):
                    pending.answer = answer
                self._busy = False
                self._changed.notify_all()
