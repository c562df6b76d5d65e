"""Gathered: what several connections ask for at about the same time, the policy is asked in one call."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Condition

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, Policy
from vlafuzz.policies.batching import Answer, Asked, BatchingPolicy

# Seconds that a question waits for others: less than a simulator needs for a step and a picture, and only
# while there are rollouts that have not asked.
WAIT = 0.005


class _Question:
    """``answer``: None as long as there is none."""

    def __init__(self, caller: int, asked: Asked) -> None:
        self.caller, self.asked = caller, asked
        self.answer: Answer | None = None


class Gathered:
    """One policy for many threads, which has no thread of its own.

    Who asks while nobody else does gathers the questions of the others, for ``wait`` seconds at most, has all
    of them answered, and gives everybody his answer. What is asked meanwhile is gathered by the next one.
    """

    def __init__(self, policy: Policy, wait: float = WAIT) -> None:
        self._batching, self._most, self._wait = BatchingPolicy(policy), policy.spec.max_batch, wait
        self._changed, self._busy = Condition(), False
        self._open: list[_Question] = []
        self._live: set[int] = set()  # callers in the middle of a rollout: they will ask

    def ask(self, caller: int, asked: Asked) -> Sequence[ActionChunk]:
        """One chunk for each observation; waits for them.

        Raises:
            PolicyError: whatever the policy raised.
        """
        mine = _Question(caller, asked)
        with self._changed:
            self._open.append(mine)
            (self._live.discard if asked.over else self._live.add)(caller)
            self._changed.notify_all()
            self._changed.wait_for(lambda: mine.answer is not None or not self._busy)
            if mine.answer is None:
                self._busy = True
                self._changed.wait_for(self._enough, self._wait)
        if mine.answer is None:
            self._answer_all()
        assert mine.answer is not None
        if isinstance(mine.answer, PolicyError):
            raise mine.answer
        return mine.answer

    def _enough(self) -> bool:
        """Whether nobody is to be waited for."""
        asking = sum(bool(question.asked.act) for question in self._open)
        return not asking or asking >= min(self._most, len(self._live))

    def _answer_all(self) -> None:
        with self._changed:
            questions, self._open = self._open, []
        answers: Sequence[Answer] = [PolicyError("the policy gave no answer")] * len(questions)
        try:
            answers = self._batching.answer([(each.caller, each.asked) for each in questions])
        finally:  # whatever it is that comes out of the policy, nobody is to wait for ever
            with self._changed:
                for question, answer in zip(questions, answers, strict=True):
                    question.answer = answer
                self._busy = False
                self._changed.notify_all()
