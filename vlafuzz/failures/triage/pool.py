"""PooledRunner: a scene runner whose rollouts are spread over processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from vlafuzz.errors import SimulatorError
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.model.evidence import Actions, Solver
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts import forks
from vlafuzz.store.records import Run

T = TypeVar("T")
R = TypeVar("R")
Make = Callable[[Run], SceneRunner]


@contextmanager
def process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes with one thread each; a SimulatorError where one of them dies."""
    with forks.single_threaded():
        environment = dict(os.environ)
    pool = ProcessPoolExecutor(workers, forks.context(), forks.settle_in, (environment,))
    try:
        with forks.single_threaded():  # the server starts with the first process
            yield pool
    except (BrokenProcessPool, EOFError):  # the latter where the server that forks them dies
        hint = "repeat the command to continue, perhaps with fewer --workers"
        raise SimulatorError("a worker died; finished findings are stored", hint=hint) from None
    finally:
        pool.shutdown(cancel_futures=True)


def side_by_side(
    pool: ProcessPoolExecutor, workers: int, function: Callable[[T], R], items: Sequence[T]
) -> Iterator[tuple[int, R]]:
    """Call a function, whose rollouts are the pool's, for several items at a time.

    Yields each item's number with the result, in the order in which they are done. Where the caller stops,
    the pool does, too: what is running could not end otherwise.
    """
    threads = ThreadPoolExecutor(workers)
    try:
        numbers = {threads.submit(function, item): number for number, item in enumerate(items)}
        for future in as_completed(numbers):
            yield numbers[future], future.result()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    finally:
        threads.shutdown(cancel_futures=True)


class PooledRunner:
    """A ``SceneRunner`` for the findings of a run. Threads may share it: batches of several findings mix.

    Args:
        make: makes the scene runner of a run, once in every process; picklable.

    Attributes:
        renderer: as that of the processes' runners; None where they have none.
    """

    def __init__(self, pool: ProcessPoolExecutor, make: Make, run: Run) -> None:
        self._pool, self._make, self._run = pool, make, run
        about = pool.submit(_about, make, run).result()
        self.space, self.stages, self.deterministic, self.renderer = about

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        rolled = [
            self._submit("evaluate", [scene], [number]) for scene, number in zip(scenes, numbers, strict=True)
        ]
        return [outcome for future in rolled for outcome in future.result()]

    def renew(self) -> None:
        """Nothing: several findings share the environments, which keep nothing of earlier scenes."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        outcome: Outcome = self._submit("solve", scene, attempt, solver).result()
        return outcome

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        outcome: Outcome = self._submit("play", scene, actions).result()
        return outcome

    def picture(self, scene: Scene) -> bytes | None:
        picture: bytes | None = self._submit("picture", scene).result()
        return picture

    def close(self) -> None:
        """Nothing: the pool's owner closes it."""

    def _submit(self, method: str, *arguments: Any) -> Future[Any]:
        return self._pool.submit(_call, self._make, self._run, method, arguments)


_runners: dict[int, SceneRunner] = {}  # of a worker process, by run


def _runner(make: Make, run: Run) -> SceneRunner:
    """The scene runner of a worker process, which keeps that of the last run only."""
    if run.id not in _runners:
        for runner in _runners.values():
            runner.close()
        _runners.clear()
        _runners[run.id] = make(run)
    return _runners[run.id]


def _about(make: Make, run: Run) -> tuple[Any, ...]:
    runner = _runner(make, run)
    return runner.space, runner.stages, runner.deterministic, getattr(runner, "renderer", None)


def _call(make: Make, run: Run, method: str, arguments: tuple[Any, ...]) -> Any:
    return getattr(_runner(make, run), method)(*arguments)
