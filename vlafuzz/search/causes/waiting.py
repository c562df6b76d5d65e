"""Waiting: the failures that are still to be attributed, and which of them is next."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Mask
from vlafuzz.search.causes.units import Levels


class Waiting:
    """Failures in which few units deviate come first; among these, and among the others, the most promising one."""

    def __init__(self) -> None:
        self._few: deque[Levels] = deque()
        self._others: deque[Levels] = deque()
        self._promises: dict[bytes, float] = {}  # as last looked at
        self._tried: set[bytes] = set()

    def __iter__(self) -> Iterator[Levels]:
        yield from (*self._few, *self._others)

    @property
    def any_of_few(self) -> bool:
        """Whether one in which few units deviate waits."""
        return bool(self._few)

    def add(self, levels: Levels, *, few: bool) -> None:
        """Add a failure; ``few``: few units deviate in it."""
        (self._few if few else self._others).append(levels)

    def again(self, levels: Levels) -> None:
        """Add a failure whose attribution was stopped, before all others with many units."""
        self._others.appendleft(levels)

    def tried(self, levels: Levels) -> bool:
        """Whether the likeliest rule was tried on a failure, and does not explain it."""
        return levels.tobytes() in self._tried

    def not_explained(self, levels: Levels) -> None:
        """The rule that was tried on a failure does not explain it: it waits again."""
        self._tried.add(levels.tobytes())
        self.add(levels, few=True)

    def forget(self, explained: Callable[[NDArray[np.int64]], Mask]) -> None:
        """Forget what those failures promised that a new rule may explain, by their ``(n, dim)`` levels."""
        waiting = list(self)
        for index in np.flatnonzero(explained(np.array(waiting))) if waiting else ():
            self._promises.pop(waiting[index].tobytes(), None)

    def next(self, promise: Callable[[Levels], float]) -> Levels | None:
        """Take out the failure that promises most; what another promised before stands unless a new rule explains it.

        Hundreds wait where half of the scenes fail, and a promise takes 5 ms in which all workers would wait.
        """
        waiting = self._few or self._others
        if not waiting:
            return None
        promises = [self._promises.get(levels.tobytes(), math.inf) for levels in waiting]
        while True:
            best = int(np.argmax(promises))
            levels = waiting[best]
            promises[best] = self._promises[levels.tobytes()] = promise(levels)
            if int(np.argmax(promises)) == best:
                del waiting[best]
                return levels
