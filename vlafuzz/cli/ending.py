"""How a command ends early: signals, and a stdout that cannot be written."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn, TextIO

from vlafuzz.common.files import reason

CLOSED = 141  # exit code of a program whose reader is gone, as shells have it
INTERRUPTED = 130
GRACE = 4.0  # seconds in which an interruption is heard
_waiting: list[threading.Timer] = []


@contextmanager
def ending_in_order() -> Iterator[None]:
    """SIGTERM ends the command as Ctrl-C does, in order; a second one of either ends it at once.

    So does the first one if nothing has ``heard`` it after ``GRACE`` seconds: compiled code may swallow it, and so does
    scipy's for an import.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # where signals cannot be handled
        return
    signals = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, _interrupt) for number in signals}
    try:
        yield
    finally:
        heard()
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(*_: object) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end_at_once)
    timer = threading.Timer(GRACE, _end_at_once)
    timer.daemon = True
    _waiting.append(timer)
    timer.start()
    raise KeyboardInterrupt


def heard() -> bool:
    """The command ends in order, and may take its time; whether nobody had heard an interruption before."""
    unheard = bool(_waiting)
    while _waiting:
        _waiting.pop().cancel()
    return unheard


def _end_at_once(*_: Any) -> None:
    leave("\nended at once: finished trials are stored")


def leave(words: str = "") -> NoReturn:
    """End the process and all that it started, at once, as interrupted."""
    from multiprocessing import active_children

    for child in active_children():
        child.kill()
    if server := sys.modules.get("multiprocessing.forkserver"):
        with suppress(OSError, TypeError):  # it may not run
            os.kill(server._forkserver._forkserver_pid, signal.SIGKILL)
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    if words:
        os.write(2, f"{words}\n".encode())
    os._exit(INTERRUPTED)


class StdoutError(Exception):
    """Stdout cannot be written. ``exit_code``: 141 where its reader is gone, which needs no message."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"stdout: cannot be written: {reason(error)}")
        self.exit_code = CLOSED if isinstance(error, BrokenPipeError) else 2


class Checked:
    """Stdout; what prevents a write is a StdoutError, and not mistaken for an error of another file."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return int(self._checked(self._stream.write, text))

    def flush(self) -> None:
        self._checked(self._stream.flush)

    def _checked(self, act: Callable[..., Any], *given: str) -> Any:
        try:
            return act(*given)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for Python's flush at its end
            raise StdoutError(error) from None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
