"""Archive: recent scenes as points, and how far other scenes are from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]  # (n, k)


class Archive:
    """The last ``capacity`` points: bounded, so that the cost of a query does not grow with the run."""

    def __init__(self, capacity: int = 500) -> None:
        self._points: Points | None = None
        self._capacity, self._added = capacity, 0

    def __len__(self) -> int:
        return min(self._added, self._capacity)

    def add(self, point: NDArray[np.float64]) -> None:
        """Keep a ``(k,)`` point; when the archive is full it replaces the oldest."""
        if self._points is None:
            self._points = np.empty((self._capacity, len(point)))
        self._points[self._added % self._capacity] = point
        self._added += 1

    def novelty(self, points: Points, neighbours: int = 5) -> NDArray[np.float64]:
        """``(n,)`` mean distance to the nearest points in the archive; 0 for an empty archive.

        A point that is in the archive is not its own neighbour.
        """
        if self._points is None:
            return np.zeros(len(points))
        known = self._points[: len(self)]
        squares = (points**2).sum(axis=1)[:, None] + (known**2).sum(axis=1) - 2 * points @ known.T
        distances = np.sort(np.sqrt(np.maximum(squares, 0.0)), axis=1)
        own = distances[:, 0] < 1e-6
        nearest = np.where(own[:, None], np.roll(distances, -1, axis=1), distances)[:, :neighbours]
        counted = np.minimum(len(known) - own, neighbours)
        kept = np.where(np.arange(nearest.shape[1]) < counted[:, None], nearest, 0.0)
        return np.asarray(kept.sum(axis=1) / np.maximum(counted, 1))
