"""Heartbeat: a line about long work now and then, where no terminal shows a bar."""

import threading
import time
from collections.abc import Callable

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration

EVERY = 30.0  # seconds


class Heartbeat:
    """Calls ``write`` with the state of the work every half minute, from a thread of its own.

    Args:
        until: when the work ends at the latest.
    """

    def __init__(self, write: Callable[[str], None], every: float = EVERY, until: Deadline | None = None) -> None:
        self._write, self._every, self._until = write, every, until or Deadline()
        self._state: tuple[str, int, int | None, str] | None = None
        self._began, self._first = time.monotonic(), 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, daemon=True)

    def tell(self, description: str, done: int, total: int | None, more: str = "") -> None:
        """``done`` of ``total`` steps are finished; with another total, or fewer, it is another work."""
        before, self._state = self._state, (description, done, total, more)
        if before is None or before[2] != total or done < before[1]:
            self._began, self._first = time.monotonic(), done
        if before is None:
            self._thread.start()

    def stop(self) -> None:
        """Write no more lines."""
        self._over.set()

    def line(self) -> str:
        """What is done, since when, and how long the rest will take at the same rate."""
        assert self._state
        description, done, total, more = self._state
        spent = time.monotonic() - self._began
        left = ""
        if total and self._first < done < total:
            seconds = spent * (total - done) / (done - self._first)
            left = f", about {duration(max(min(seconds, self._until.left), 0.0))} left"
        of = f"{done} of {total}" if total else str(done)
        return f"{description}: {of}{more}, {duration(spent)} so far{left}"

    def _beat(self) -> None:
        while not self._over.wait(self._every):
            self._write(self.line())
