"""ProcessExecutor: scenes are evaluated in several processes of this machine, each with its own simulator."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import connection, get_context
from pathlib import Path
from typing import Any

from vlafuzz.errors import VlafuzzError
from vlafuzz.execute.local import evaluate_safely
from vlafuzz.execute.threads import single_threaded
from vlafuzz.execute.worker_pool import LOOK, TIMEOUT, Lost, WorkerPool
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Evaluator


class ProcessExecutor:
    """Workers that are spawned once, with one thread each, and replaced when they die.

    A batch whose worker dies, hangs or eats the memory is tried once more in another one, then its scenes are
    ERROR. A worker that never gets ready counts as one that died.

    Args:
        make: makes a worker's evaluator, in the worker; picklable.
        workers: number of processes.
        timeout: seconds that a scene may take before its worker is killed; the first one of a worker with the
            start of its simulator.
        memory: bytes that a worker may hold; None for its share.
        after: what is to be done at the end, when the workers are gone.
    """

    def __init__(
        self,
        make: Callable[[], Evaluator],
        workers: int,
        *,
        timeout: float = TIMEOUT,
        memory: int | None = None,
        after: Callable[[], None] = lambda: None,
    ) -> None:
        most = memory or share(workers)
        self._crew = WorkerPool(lambda: _Process(make, timeout, most), _wait, workers)
        self._after = after

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``."""
        return self._crew.run(batches)

    def close(self) -> None:
        """End all workers."""
        self._crew.kill()
        self._after()


def share(workers: int) -> int:
    """Bytes of memory for each of these workers: they share four fifths of the machine's."""
    return int(0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / workers)


class _Process:
    """A worker, and the pipe to it."""

    def __init__(self, make: Callable[[], Evaluator], timeout: float, memory: int) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(make, theirs), daemon=True)
        with single_threaded():
            self._process.start()
        theirs.close()
        self._timeout, self._memory = timeout, memory
        self._up, self._began, self._scenes = False, 0.0, 0

    def ready(self) -> bool:
        """See ``Worker``."""
        return True

    def begin(self, scenes: Sequence[Scene]) -> None:
        """See ``Worker``. When nobody is there to read, ``recv`` will tell."""
        self._began, self._scenes = time.monotonic(), len(scenes)
        with suppress(OSError):
            self.pipe.send(list(scenes))

    def answer(self) -> list[Outcome] | None:
        """See ``Worker``."""
        try:
            if not self.pipe.poll():
                self._check()
                return None
            told = self.pipe.recv()
        except (EOFError, OSError):
            raise Lost(cause_of_death(self._process)) from None
        if told is None:  # it has started: from now on, time counts
            self._up, self._began = True, time.monotonic()
        if isinstance(told, BaseException):
            raise told
        return told  # type: ignore[no-any-return]

    def kill(self) -> None:
        """See ``Worker``."""
        self._process.kill()
        self._process.join()
        self.pipe.close()

    def _check(self) -> None:
        """Whether it may go on."""
        allowed = self._timeout * max(self._scenes, 1) if self._up else TIMEOUT
        if time.monotonic() - self._began > allowed:
            raise Lost(f"no answer within {allowed:.0f} s")
        if _resident(self._process.pid) > self._memory:
            raise Lost(f"held more than {self._memory / 2**30:.1f} GiB of memory")


def _wait(workers: Sequence[Any]) -> None:
    connection.wait([worker.pipe for worker in workers], timeout=LOOK)


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
        except (VlafuzzError, KeyboardInterrupt, Lost) as error:  # nothing that this worker can help
            pipe.send(error)


def cause_of_death(process: Any) -> str:
    """Of a process that has closed its pipe, in words."""
    process.join(5.0)
    code = process.exitcode
    if code is not None and code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


def _resident(pid: int | None) -> int:
    """Bytes in memory; 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
