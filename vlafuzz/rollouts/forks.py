"""Worker processes, forked from a server that loads what they need once for all of them: it takes seconds."""

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import connection, forkserver, get_context, parent_process, resource_tracker
from multiprocessing.context import ForkServerContext
from threading import Thread

from vlafuzz.worlds import known_worlds

_SINGLE = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}


def context() -> ForkServerContext:
    """The context whose processes are forked from the server; they have to call ``settle_in`` first."""
    forked = get_context("forkserver")
    ours = known_worlds.cache_info().currsize > 0  # else it is a world of the user's own
    forked.set_forkserver_preload(["vlafuzz.rollouts.preload" if ours else "vlafuzz.rollouts.setup"])
    return forked


def load_early(*, ours: bool) -> None:
    """Let the server load from now on what workers need; ``ours``: a simulator of ours, too."""
    if ours:
        known_worlds()
    context()
    with single_threaded():
        forkserver.ensure_running()


def settle_in(environment: Mapping[str, str]) -> None:
    """Begin the life of a forked process, in the environment of the process that asked for it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends the workers
    Thread(target=_end_with_parent, daemon=True).start()
    sys.stdout = sys.stderr  # a policy may print, and stdout is for data
    os.environ.clear()
    os.environ.update(environment)
    import numpy as np

    np.random.seed()  # noqa: NPY002 - a user's policy may draw from it: not the same in all workers


def _end_with_parent() -> None:
    """End this process as soon as the one that asked for it is gone, however that ended.

    A worker that waits for work would not notice: it holds the other end of its queue, too.
    """
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes started in the block use one thread: there are many, and threads would change last bits.

    It sets environment variables, since numerical libraries read them on import, before any of our code.
    """
    before = {name: os.environ.get(name) for name in _SINGLE}
    os.environ.update(_SINGLE)
    resource_tracker.ensure_running()  # whose start would let the signal through again
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # a server that begins does not hear Ctrl-C
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
