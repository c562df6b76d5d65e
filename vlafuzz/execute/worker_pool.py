"""Crew: workers that evaluate batches side by side, and are replaced when they are lost."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from vlafuzz.errors import PrerequisiteError
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene

TRIES = 2  # of a batch, by different workers, before it is an ERROR
TIMEOUT = 300.0  # seconds that a scene may take
LOOK = 0.5  # seconds between two looks at workers that say nothing


class Lost(BaseException):
    """A worker, or what it cannot do without, is gone; the message says how.

    No ``Exception``: those are taken for an outcome of the scene, and this is none.
    """


class Worker(Protocol):
    """Somebody who evaluates one batch at a time, elsewhere."""

    def ready(self) -> bool:
        """Whether it can be given one. A process can at once; an actor has to find room in its cluster."""

    def begin(self, scenes: Sequence[Scene]) -> None:
        """Start on a batch. Raises nothing: ``answer`` will tell."""

    def answer(self) -> list[Outcome] | None:
        """What came of it; None while it is at it.

        Raises:
            Lost: it is of no use any more.
            VlafuzzError: the user has to mend or start something first.
        """

    def kill(self) -> None:
        """At once."""


@dataclass(eq=False)
class _Batch:
    tag: int
    scenes: Sequence[Scene]
    tries: int = 0


@dataclass(eq=False)
class _Post:
    worker: Worker
    batch: _Batch | None = None


class WorkerPool:
    """What all executors with workers have in common.

    A batch whose worker is lost is tried once more by another one, then its scenes are ERROR.

    Args:
        hire: starts a worker.
        wait: waits for a short time until one of those that are busy may have an answer.
        count: number of workers; they start when there is something to do.
    """

    def __init__(self, hire: Callable[[], Worker], wait: Callable[[Sequence[Worker]], None], count: int):
        self._hire, self._wait, self._count = hire, wait, count
        self._posts: list[_Post] = []
        self._again: deque[_Batch] = deque()

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``."""
        todo, worked = iter(batches), time.monotonic()
        self._again.clear()
        try:
            while len(self._posts) < self._count:
                self._posts.append(_Post(self._hire()))
            while True:
                over = self._hand_out(todo)
                busy = [post for post in self._posts if post.batch]
                if busy:
                    worked = time.monotonic()
                elif over:
                    return
                elif time.monotonic() - worked > TIMEOUT:
                    raise PrerequisiteError(f"no worker is ready within {TIMEOUT:.0f} s", hint="`ray status`")
                self._wait([post.worker for post in busy or self._posts])
                for post in busy:
                    yield from self._look_at(post)
        except BaseException:
            self.kill()  # what the workers are still at belongs to nobody
            raise

    def kill(self) -> None:
        """End all workers; the next run starts others."""
        for post in self._posts:
            post.worker.kill()
        self._posts = []

    def _hand_out(self, todo: Iterator[tuple[int, Sequence[Scene]]]) -> bool:
        """Give batches to those who have none and are ready; whether there were too few."""
        for post in self._posts:
            if post.batch is None and post.worker.ready():
                post.batch = self._again.popleft() if self._again else _next(todo)
                if post.batch is None:
                    return True
                post.batch.tries += 1
                post.worker.begin(post.batch.scenes)
        return False

    def _look_at(self, post: _Post) -> Iterator[tuple[int, list[Outcome]]]:
        assert post.batch is not None
        try:
            outcomes = post.worker.answer()
        except Lost as why:
            outcomes = self._replace(post, str(why))
        if outcomes is not None:
            batch, post.batch = post.batch, None
            yield batch.tag, outcomes

    def _replace(self, post: _Post, why: str) -> list[Outcome] | None:
        """Another worker in place of one that is lost; its batch is tried again, or given up."""
        batch = post.batch
        assert batch is not None
        post.worker.kill()
        post.worker = self._hire()
        if batch.tries >= TRIES:
            return [Outcome.error(f"worker: {why}, {TRIES} times")] * len(batch.scenes)
        post.batch = None
        self._again.append(batch)
        return None


def _next(todo: Iterator[tuple[int, Sequence[Scene]]]) -> _Batch | None:
    return next((_Batch(tag, scenes) for tag, scenes in todo), None)
