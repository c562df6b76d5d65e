"""How a command ends early: signals, and a stdout that cannot be written."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from vlafuzz.files import reason

CLOSED = 141  # exit code of a program whose reader is gone, as shells have it
INTERRUPTED = 130


@contextmanager
def ending_in_order() -> Iterator[None]:
    """SIGTERM ends the command as Ctrl-C does, in order; a second one of either ends it at once."""
    if threading.current_thread() is not threading.main_thread():
        yield  # where signals cannot be handled
        return
    signals = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, _interrupt) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(*_: Any) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end_at_once)
    raise KeyboardInterrupt


def _end_at_once(*_: Any) -> None:
    from multiprocessing import active_children

    for child in active_children():
        child.kill()
    os.write(2, b"\nended at once: finished trials are stored\n")
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
        with _checked():
            return self._stream.write(text)

    def flush(self) -> None:
        with _checked():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def _checked() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for Python's flush at its end
        raise StdoutError(error) from None
