"""ProcessExecutor: scenes are evaluated in several processes of this machine, each with its own simulator."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context
from pathlib import Path
from typing import Any

from vlafuzz.errors import VlafuzzError
from vlafuzz.execute.local import evaluate_safely
from vlafuzz.execute.threads import single_threaded
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Evaluator

TRIES = 2  # of a batch, in different processes, before it is an ERROR
TIMEOUT = 300.0  # seconds that a scene may take
LOOK = 0.5  # seconds between two looks at time and memory


@dataclass
class _Batch:
    tag: int
    scenes: Sequence[Scene]
    tries: int = 0


class ProcessExecutor:
    """Workers that are spawned once, with one thread each, and replaced when they die.

    A batch whose worker dies, hangs or eats the memory is tried once more in another one, then its scenes are
    ERROR. A worker that never gets ready counts as one that died.

    Args:
        make: makes a worker's evaluator, in the worker; picklable.
        workers: number of processes.
        timeout: seconds that a scene may take before its worker is killed; the first one of a worker with the
            start of its simulator.
        memory: bytes that a worker may hold; None for its share of four fifths of the machine's.
    """

    def __init__(
        self,
        make: Callable[[], Evaluator],
        workers: int,
        *,
        timeout: float = TIMEOUT,
        memory: int | None = None,
    ) -> None:
        self._make, self._timeout = make, timeout
        self._memory = memory or int(0.8 * _machine_memory() / workers)
        self._count, self._workers = workers, list[_Worker]()

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``."""
        todo, again = iter(batches), deque[_Batch]()
        self._workers = self._workers or [_Worker(self._make) for _ in range(self._count)]
        try:
            while True:
                self._hand_out(todo, again)
                busy = [worker for worker in self._workers if worker.batch]
                if not busy:
                    return
                for worker in _ready(busy):
                    yield from self._collect(worker, again)
                for worker in busy:
                    if worker.batch and (why := worker.trouble(self._timeout, self._memory)):
                        yield from self._replace(worker, why, again)
        except BaseException:
            self.close()  # what the workers are still at belongs to nobody
            raise

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.kill()
        self._workers = []

    def _hand_out(self, todo: Iterator[tuple[int, Sequence[Scene]]], again: deque[_Batch]) -> None:
        for worker in self._workers:
            if worker.batch is None:
                batch = again.popleft() if again else _next(todo)
                if batch is None:
                    return
                worker.begin(batch)

    def _collect(self, worker: _Worker, again: deque[_Batch]) -> Iterator[tuple[int, list[Outcome]]]:
        assert worker.batch is not None
        try:
            answer = worker.pipe.recv()
        except (EOFError, OSError):
            yield from self._replace(worker, worker.cause_of_death(), again)
            return
        if answer is None:
            worker.up()
            return
        if isinstance(answer, BaseException):
            raise answer
        batch, worker.batch = worker.batch, None
        yield batch.tag, answer

    def _replace(
        self, worker: _Worker, why: str, again: deque[_Batch]
    ) -> Iterator[tuple[int, list[Outcome]]]:
        """A new worker in place of one that is of no use; its batch is tried again, or given up."""
        batch = worker.batch
        assert batch is not None
        worker.kill()
        self._workers[self._workers.index(worker)] = _Worker(self._make)
        if batch.tries < TRIES:
            again.append(batch)
        else:
            yield batch.tag, [Outcome.error(f"worker: {why}, {TRIES} times")] * len(batch.scenes)


class _Worker:
    """One process, the pipe to it, and what it is at."""

    def __init__(self, make: Callable[[], Evaluator]) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(make, theirs), daemon=True)
        with single_threaded():
            self._process.start()
        theirs.close()
        self.batch: _Batch | None = None
        self._up, self._began = False, 0.0

    def begin(self, batch: _Batch) -> None:
        """Send it; when nobody is there to read, ``recv`` will tell."""
        self.batch, self._began = batch, time.monotonic()
        batch.tries += 1
        with suppress(OSError):
            self.pipe.send(list(batch.scenes))

    def up(self) -> None:
        """It has started: from now on, time counts."""
        self._up, self._began = True, time.monotonic()

    def trouble(self, timeout: float, memory: int) -> str | None:
        """Why it is of no use any more, in words."""
        assert self.batch is not None
        allowed = timeout * max(len(self.batch.scenes), 1) if self._up else TIMEOUT
        if time.monotonic() - self._began > allowed:
            return f"no answer within {allowed:.0f} s"
        if _resident(self._process.pid) > memory:
            return f"held more than {memory / 2**30:.1f} GiB of memory"
        return None

    def cause_of_death(self) -> str:
        """In words, once the pipe is closed."""
        self._process.join(5.0)
        code = self._process.exitcode
        if code is not None and code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"

    def kill(self) -> None:
        """At once."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(make: Callable[[], Evaluator], pipe: Any) -> None:
    """A worker's life: scenes in, outcomes out, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, who ends the workers
    evaluator: Evaluator | None = None
    pipe.send(None)
    while True:
        try:
            scenes = pipe.recv()
        except EOFError:
            return
        try:
            evaluator = evaluator or make()
            pipe.send(evaluate_safely(evaluator, scenes))
        except (VlafuzzError, KeyboardInterrupt) as error:  # nothing that another scene would not meet, too
            pipe.send(error)


def _ready(workers: Sequence[_Worker]) -> list[_Worker]:
    """Those that have answered or died, within a short time."""
    pipes = connection.wait([worker.pipe for worker in workers], timeout=LOOK)
    return [worker for worker in workers if worker.pipe in pipes]


def _next(todo: Iterator[tuple[int, Sequence[Scene]]]) -> _Batch | None:
    return next((_Batch(tag, scenes) for tag, scenes in todo), None)


def _resident(pid: int | None) -> int:
    """Bytes in memory; 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _machine_memory() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
