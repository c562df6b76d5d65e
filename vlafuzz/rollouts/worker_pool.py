"""Worker pool: workers that evaluate scenes in parallel, and are replaced when they are lost."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, Protocol

from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Outcome
from vlafuzz.rollouts.executor import Tagged

TRIES = 2  # attempts at a scene, by different workers, before it is ERROR
TIMEOUT = 300.0  # seconds per scene
# Seconds between two checks of silent workers, after which an idle one is also offered what was asked for meanwhile.
LOOK = 0.02
_END = (-1, None)  # after the last scene


class Lost(BaseException):
    """A worker, or a process that it depends on, is gone; the message says how.

    It is no ``Exception``, since evaluators turn those into outcomes of the scene.
    """


class Worker(Protocol):
    """Evaluates one scene at a time, beside others."""

    def ready(self) -> bool:
        """Whether it accepts a scene: a process does at once, an actor when its cluster has room."""

    def begin(self, scene: Any) -> None:
        """Start on a scene."""

    def answer(self) -> Sequence[Outcome]:
        """The outcome, none while the scene is in progress; Lost, or a VlafuzzError for the user, is raised."""

    def kill(self) -> None:
        """End it at once, with what it does."""


@dataclass(eq=False)
class _Job:
    tag: int
    scene: Any
    tries: int = 0


@dataclass(eq=False)
class _Slot:
    worker: Worker
    job: _Job | None = None


class WorkerPool:
    """An ``Executor`` with workers, which start with the first scene.

    The scene of a lost worker is tried once more by another one; after that, it is ERROR.

    Args:
        wait: blocks until one of the given workers may have an answer, or for so many seconds.
        after: called at the end, when the workers are gone.
    """

    def __init__(
        self,
        start: Callable[[], Worker],
        wait: Callable[[Sequence[Any], float], None],
        workers: int,
        after: Callable[[], None] = lambda: None,
    ) -> None:
        self._start, self._wait, self._count, self._after = start, wait, workers, after
        self._slots: list[_Slot] = []
        self._retries: deque[_Job] = deque()

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        scenes = iter(scenes)
        first = list(islice(scenes, 1))  # now, as the start of workers may wait for the simulator's import
        todo, last_busy = chain(first, scenes), time.monotonic()
        self._retries.clear()
        try:
            while len(self._slots) < self._count:
                self._slots.append(_Slot(self._start()))
            while True:
                exhausted = self._hand_out(todo)
                busy = [slot for slot in self._slots if slot.job]
                if busy:
                    last_busy = time.monotonic()
                elif exhausted:
                    return
                elif time.monotonic() - last_busy > TIMEOUT:
                    raise PrerequisiteError(f"no worker is ready within {TIMEOUT:.0f} s", hint="`ray status`")
                self._wait([slot.worker for slot in busy or self._slots], LOOK)
                for slot in busy:
                    yield from self._collect(slot)
        except BaseException:
            self._kill()  # nobody will collect the outcomes of scenes that are still in progress
            raise

    def close(self) -> None:
        self._kill()
        self._after()

    def _kill(self) -> None:
        for slot in self._slots:
            slot.worker.kill()
        self._slots = []

    def _hand_out(self, todo: Iterator[tuple[int, Any] | None]) -> bool:
        """Give scenes to idle workers that are ready; whether the scenes are exhausted."""
        for slot in self._slots:
            if slot.job is None and slot.worker.ready():
                if not self._retries:
                    tagged = next(todo, _END)
                    if tagged is None or tagged is _END:
                        return tagged is _END
                    self._retries.append(_Job(*tagged))
                slot.job = self._retries.popleft()
                slot.job.tries += 1
                slot.worker.begin(slot.job.scene)
        return False

    def _collect(self, slot: _Slot) -> Iterator[tuple[int, Outcome]]:
        """The outcome of a scene if it is there. A lost worker is replaced; its scene is queued again, or ERROR."""
        job = slot.job
        assert job is not None
        try:
            outcomes = slot.worker.answer()
        except Lost as cause:
            slot.worker.kill()
            slot.worker, slot.job = self._start(), None
            if job.tries < TRIES:
                self._retries.append(job)
                return
            outcomes = [Outcome.error(f"worker: {cause}, {TRIES} times")]
        for outcome in outcomes:
            slot.job = None
            yield job.tag, outcome
