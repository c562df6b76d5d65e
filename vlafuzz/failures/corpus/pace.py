"""Pace: how long all rollouts of a comparison take, by the first of them."""

import time
from collections.abc import Callable

from vlafuzz.common.text import duration, plural

FIRST, SOON = 5, 20.0  # rollouts, or seconds of at least one, after which the time of one is known
NOBODY_WAITS = 10.0  # seconds for which nothing is said


class Pace:
    """Says once how long the rest of so many steps takes; call ``step`` after each.

    The first one is not counted: the simulator starts in it.
    """

    def __init__(self, note: Callable[[str], None], steps: int) -> None:
        self._note, self._steps, self._done, self._said = note, steps, 0, False
        self._began = 0.0

    def step(self) -> None:
        """One more is done."""
        now = time.monotonic()
        self._done += 1
        if self._done == 1:
            self._began = now
        took, counted = now - self._began, self._done - 1
        if self._said or not counted or (counted < FIRST and took < SOON):
            return
        self._said = True
        left = took / counted * (self._steps - self._done)
        if left > NOBODY_WAITS:
            basis = f"at the speed of the first {plural(self._done, 'rollout')}"
            self._note(f"about {duration(left)} for the other {self._steps - self._done}, {basis}")
