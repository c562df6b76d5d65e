"""Process executor: evaluates scenes in several processes of this machine, each with its own simulator."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import connection
from typing import Any

from vlafuzz.errors import PrerequisiteError, VlafuzzError
from vlafuzz.model import Outcome
from vlafuzz.rollouts import forks
from vlafuzz.rollouts.executor import evaluate_safely
from vlafuzz.rollouts.worker_pool import TIMEOUT, Lost, WorkerPool
from vlafuzz.worlds.evaluator import Evaluator

Make = Callable[[], Evaluator]  # makes a worker's evaluator, in the worker; picklable


class ProcessExecutor(WorkerPool):
    """Workers that are forked once, with one thread each, and replaced when they die.

    When a worker dies or hangs, its scene is tried once more in another one; after that, it is ERROR. A worker that
    never becomes ready counts as dead; so does one that the system ends for want of memory.

    Args:
        timeout: seconds per scene before its worker is killed; the first one includes the simulator's start.
        options: see ``WorkerPool``.
    """

    def __init__(self, make: Make, workers: int, *, timeout: float = TIMEOUT, **options: Any) -> None:
        super().__init__(lambda: _started(make, timeout), _wait, workers, **options)


def _started(make: Make, timeout: float) -> "_Process":
    """A worker; where the server that forks them dies, another one begins, once."""
    with suppress(EOFError, OSError):
        return _Process(make, timeout)
    try:
        return _Process(make, timeout)
    except (EOFError, OSError) as error:
        message = f"no worker process starts: {type(error).__name__}: {error}"
        raise PrerequisiteError(message, hint="is there memory for it? --workers 1 needs none") from None


class _Process:
    """A ``Worker`` in a process, with the pipe to it."""

    def __init__(self, make: Make, timeout: float) -> None:
        forked = forks.context()
        self.pipe, child_end = forked.Pipe()
        self._process = forked.Process(target=_serve, args=(child_end,), daemon=True)
        with forks.single_threaded():
            self._process.start()
            child_end.close()
            self._send(dict(os.environ))
        self._send(make)
        self._timeout, self._up, self._began = timeout, False, 0.0

    def ready(self) -> bool:
        return True

    def begin(self, scene: Any) -> None:
        self._began = time.monotonic()
        self._send(scene)

    def answer(self) -> Sequence[Outcome]:
        try:
            if not self.pipe.poll():
                allowed = self._timeout if self._up else TIMEOUT
                if time.monotonic() - self._began > allowed:
                    raise Lost(f"no answer within {allowed:.0f} s")
                return ()
            message: Sequence[Outcome] | BaseException = self.pipe.recv()
        except (EOFError, OSError):
            raise Lost(cause_of_death(self._process)) from None
        if isinstance(message, BaseException):
            raise message
        if not message:  # the process has started: the timeout of the scene begins
            self._up, self._began = True, time.monotonic()
        return message

    def kill(self) -> None:
        self._process.kill()
        self._process.join()
        self.pipe.close()

    def _send(self, message: object) -> None:
        with suppress(OSError):  # when the process is gone, ``answer`` reports it
            self.pipe.send(message)


def _wait(workers: Sequence[Any], seconds: float) -> None:
    connection.wait([worker.pipe for worker in workers], seconds)


def _serve(pipe: Any) -> None:
    """A worker's main loop: a scene in, its outcome out, until the pipe is closed."""
    forks.settle_in(pipe.recv())
    make: Make = pipe.recv()
    evaluator: Evaluator | None = None
    pipe.send(())
    while True:
        try:
            scene = pipe.recv()
        except EOFError:
            return
        try:
            evaluator = evaluator or make()
            pipe.send((evaluate_safely(evaluator, scene),))
        except (VlafuzzError, KeyboardInterrupt, Lost) as error:  # for the parent to raise
            pipe.send(error)


def cause_of_death(process: Any) -> str:
    """How a process that has closed its pipe ended, as a predicate for messages."""
    process.join(5.0)
    code = process.exitcode
    if code is not None and code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"
