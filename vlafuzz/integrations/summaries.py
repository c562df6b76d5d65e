"""Summaries of a data set's columns, in LeRobot's words: range, mean, spread, quantiles, count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
Stats = dict[str, Any]  # nested lists of numbers


def summary(values: NDArray[Any]) -> Stats:
    """Of numbers ``(n,)`` or vectors ``(n, d)``: lists of 1 or d."""
    table = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": table.min(0), "max": table.max(0), "mean": table.mean(0), "std": table.std(0)}
    found |= zip(map(_named, QUANTILES), np.quantile(table, QUANTILES, axis=0), strict=True)
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(values)]}


@dataclass(frozen=True, eq=False)
class Levels:
    """How often each level from 0 to 255 is in each channel of so many pictures: ``counts`` (3, 256)."""

    counts: NDArray[np.int64]
    pictures: int

    @staticmethod
    def none() -> Levels:
        """Of no picture."""
        return Levels(np.zeros((3, 256), dtype=np.int64), 0)

    @staticmethod
    def of(pictures: NDArray[np.uint8]) -> Levels:
        """Of pictures ``(n, height, width, 3)``."""
        channels = [np.bincount(pictures[..., channel].reshape(-1), minlength=256) for channel in range(3)]
        return Levels(np.array(channels), len(pictures))

    def __add__(self, other: Levels) -> Levels:
        return Levels(self.counts + other.counts, self.pictures + other.pictures)

    def summary(self) -> Stats:
        """Of levels in [0, 1], by channel: lists (3, 1, 1). Quantiles are levels that occur."""
        levels, share = np.arange(256) / 255, self.counts / self.counts.sum(1, keepdims=True)
        mean, below = share @ levels, np.cumsum(share, axis=1)
        found = {
            "min": levels[(share > 0).argmax(1)],
            "max": levels[255 - (share[:, ::-1] > 0).argmax(1)],
            "mean": mean,
            "std": np.sqrt(((levels - mean[:, None]) ** 2 * share).sum(1)),
        }
        for quantile in QUANTILES:
            found[_named(quantile)] = levels[(below >= quantile - 1e-12).argmax(1)]
        return {name: each.reshape(3, 1, 1).tolist() for name, each in found.items()} | {
            "count": [self.pictures]
        }


def _named(quantile: float) -> str:
    return f"q{100 * quantile:02.0f}"
