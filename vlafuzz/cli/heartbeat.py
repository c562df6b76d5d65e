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
        write: prints a line.
        every: seconds.
        until: when the work ends at the latest.
    """

    def __init__(
        self, write: Callable[[str], None], every: float = EVERY, until: Deadline | None = None
    ) -> None:
        self._write, self._every, self._until = write, every, until or Deadline()
        self._state: tuple[str, int, int | None, str] | None = None
        self._began, self._first = time.monotonic(), 0
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def tell(self, description: str, done: int, total: int | None, more: str = "") -> None:
        """``done`` of ``total`` steps are finished; ``more`` goes beside it.

        With another total, or fewer steps done than before, it is another work.
        """
        if self._state is None or self._state[2] != total or done < self._state[1]:
            self._began, self._first = time.monotonic(), done
        self._state = description, done, total, more
        if self._thread is None:
            self._thread = threading.Thread(target=self._beat, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Write no more lines."""
        self._over.set()
        self._state = None

    def line(self) -> str:
        """What is done, since when, and how long the rest will take at the same rate."""
        if self._state is None:
            return ""
        description, done, total, more = self._state
        spent = time.monotonic() - self._began
        of = f"{done} of {total}" if total else str(done)
        left = ""
        if total and self._first < done < total:
            seconds = spent * (total - done) / (done - self._first)
            left = f", about {duration(max(min(seconds, self._until.left), 0.0))} left"
        return f"{description}: {of}{more}, {duration(spent)} so far{left}"

    def _beat(self) -> None:
        while not self._over.wait(self._every):
            if line := self.line():
                self._write(line)
