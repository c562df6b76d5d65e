"""Worker pool: workers that evaluate batches in parallel, and are replaced when they are lost."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, Protocol

from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Outcome
from vlafuzz.rollouts.executor import Batches

TRIES = 2  # attempts at a batch, by different workers, before its scenes are ERROR
TIMEOUT = 300.0  # seconds per scene
LOOK = 0.5  # seconds between two checks of silent workers
_END: tuple[int, Sequence[Any]] = (-1, ())  # after the last batch


class Lost(BaseException):
    """A worker, or a process that it depends on, is gone; the message says how.

    It is no ``Exception``, since evaluators turn those into outcomes of the scene.
    """


class Worker(Protocol):
    """Evaluates one batch at a time, in another process."""

    def ready(self) -> bool:
        """Whether it accepts a batch: a process does at once, an actor when its cluster has room."""

    def begin(self, scenes: Sequence[Any]) -> None:
        """Start on a batch. Raises nothing: ``answer`` reports errors."""

    def answer(self) -> list[Outcome] | None:
        """The outcomes of the batch, None while it is in progress; Lost, or a VlafuzzError for the user, is raised."""

    def kill(self) -> None:
        """End it at once."""


@dataclass(eq=False)
class _Batch:
    tag: int
    scenes: Sequence[Any]
    tries: int = 0


@dataclass(eq=False)
class _Slot:
    worker: Worker
    batch: _Batch | None = None


class WorkerPool:
    """An ``Executor`` with workers, which start with the first batch.

    The batch of a lost worker is tried once more by another one; after that, its scenes are ERROR.

    Args:
        wait: blocks until one of the given workers may have an answer, or for so many seconds.
        after: called at the end, when the workers are gone.
        look: seconds after which batches are pulled again.
    """

    def __init__(
        self,
        start: Callable[[], Worker],
        wait: Callable[[Sequence[Any], float], None],
        workers: int,
        after: Callable[[], None] = lambda: None,
        look: float = LOOK,
    ) -> None:
        self._start, self._wait, self._count, self._after, self._look = start, wait, workers, after, look
        self._slots: list[_Slot] = []
        self._retries: deque[_Batch] = deque()

    def run(self, batches: Batches) -> Iterator[tuple[int, list[Outcome]]]:
        batches = iter(batches)
        first = list(islice(batches, 1))  # now, as the start of workers may wait for the simulator's import
        todo, last_busy = chain(first, batches), time.monotonic()
        self._retries.clear()
        try:
            while len(self._slots) < self._count:
                self._slots.append(_Slot(self._start()))
            while True:
                exhausted = self._hand_out(todo)
                busy = [slot for slot in self._slots if slot.batch]
                if busy:
                    last_busy = time.monotonic()
                elif exhausted:
                    return
                elif time.monotonic() - last_busy > TIMEOUT:
                    raise PrerequisiteError(f"no worker is ready within {TIMEOUT:.0f} s", hint="`ray status`")
                self._wait([slot.worker for slot in busy or self._slots], self._look)
                for slot in busy:
                    yield from self._collect(slot)
        except BaseException:
            self._kill()  # nobody will collect the batches that are still in progress
            raise

    def close(self) -> None:
        self._kill()
        self._after()

    def _kill(self) -> None:
        for slot in self._slots:
            slot.worker.kill()
        self._slots = []

    def _hand_out(self, todo: Iterator[tuple[int, Sequence[Any]] | None]) -> bool:
        """Give batches to idle workers that are ready; whether the batches are exhausted."""
        for slot in self._slots:
            if slot.batch is None and slot.worker.ready():
                if not self._retries:
                    tagged = next(todo, _END)
                    if tagged is None or tagged is _END:
                        return tagged is _END
                    self._retries.append(_Batch(*tagged))
                slot.batch = self._retries.popleft()
                slot.batch.tries += 1
                slot.worker.begin(slot.batch.scenes)
        return False

    def _collect(self, slot: _Slot) -> Iterator[tuple[int, list[Outcome]]]:
        """The outcomes of a batch if they are there. A lost worker is replaced; its batch is queued again, or ERROR."""
        batch = slot.batch
        assert batch is not None
        try:
            outcomes = slot.worker.answer()
        except Lost as cause:
            slot.worker.kill()
            slot.worker, slot.batch = self._start(), None
            if batch.tries < TRIES:
                self._retries.append(batch)
                return
            outcomes = [Outcome.error(f"worker: {cause}, {TRIES} times")] * len(batch.scenes)
        if outcomes is not None:
            slot.batch = None
            yield batch.tag, outcomes
