"""Calls: functions that are called in several processes, on this machine or on a ray cluster."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from vlafuzz.errors import SimulatorError
from vlafuzz.rollouts import forks

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def process_pool(workers: int) -> Iterator[Executor]:
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
    pool: Executor, workers: int, function: Callable[[T], R], items: Sequence[T]
) -> Iterator[tuple[int, R]]:
    """Call a function, whose rollouts are the pool's, for several items at a time.

    Yields each item's number with the result, in the order in which they are done. Where the caller stops, the pool
    does, too: what is running could not end otherwise.
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
