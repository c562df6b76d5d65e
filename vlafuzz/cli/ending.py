"""How a command ends early: SIGTERM as Ctrl-C, in order, and a second one of either at once."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

CLOSED = 141  # exit code of a program whose reader is gone, as shells have it
INTERRUPTED = 130
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def ending_in_order() -> Iterator[None]:
    """SIGTERM ends the command as Ctrl-C does, in order; a second one of either ends it at once."""
    if threading.current_thread() is not threading.main_thread():
        yield  # where signals cannot be handled
        return
    before = {number: signal.signal(number, _interrupt) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(*_: object) -> None:
    for number in _SIGNALS:
        signal.signal(number, _end_at_once)
    raise KeyboardInterrupt


def _end_at_once(*_: object) -> None:
    """End the process and all that it started."""
    from multiprocessing import active_children

    for child in active_children():
        child.kill()
    if server := sys.modules.get("multiprocessing.forkserver"):
        with suppress(OSError, TypeError):  # it may not run
            os.kill(server._forkserver._forkserver_pid, signal.SIGKILL)
    os.write(2, b"\nended at once: finished trials are stored\n")
    os._exit(INTERRUPTED)
