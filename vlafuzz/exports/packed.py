"""Packed: a demonstration with compressed pictures, and what their statistics need."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vlafuzz.common.arrays import Picture
from vlafuzz.model import Scene

QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
Stats = dict[str, Any]  # nested lists of numbers
Levels = NDArray[np.int64]


def summary(values: NDArray[Any]) -> Stats:
    """Statistics of numbers ``(n,)`` or vectors ``(n, d)``, as lists of length 1 or d."""
    table = values.reshape(len(values), -1).astype(np.float64)
    stats = {"min": table.min(0), "max": table.max(0), "mean": table.mean(0), "std": table.std(0)}
    stats |= zip(map(_named, QUANTILES), np.quantile(table, QUANTILES, axis=0), strict=True)
    return {name: stat.tolist() for name, stat in stats.items()} | {"count": [len(values)]}


def levels(pictures: Picture) -> Levels:
    """How often each level from 0 to 255 occurs, by channel, in images ``(n, height, width, 3)``: ``(3, 256)``."""
    return np.array([np.bincount(pictures[..., channel].reshape(-1), minlength=256) for channel in range(3)])


def summary_of_levels(counts: Levels, pictures: int) -> Stats:
    """Statistics of levels in [0, 1] by channel: lists (3, 1, 1). Quantiles are levels that occur."""
    level, share = np.arange(256) / 255, counts / counts.sum(1, keepdims=True)
    mean, below = share @ level, np.cumsum(share, axis=1)
    stats = {
        "min": level[(share > 0).argmax(1)],
        "max": level[255 - (share[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": np.sqrt(((level - mean[:, None]) ** 2 * share).sum(1)),
        **{_named(quantile): level[(below >= quantile - 1e-12).argmax(1)] for quantile in QUANTILES},
    }
    return {name: stat.reshape(3, 1, 1).tolist() for name, stat in stats.items()} | {"count": [pictures]}


@dataclass(frozen=True, eq=False)
class Packed:
    """A demonstration, a solution from the start to success with one item per control step, its pictures as PNG.

    Attributes:
        pictures: by name, before the action; ``sizes``: their height, width and channels; ``levels``: see ``levels``.
        states: float32 ``(steps, m)``, in the policy's layout; ``actions``: ``(steps, n)``, as it writes them.
        finding: digest of the failing scene that it is for; empty for a random scene.
    """

    scene: Scene
    pictures: Mapping[str, list[bytes]]
    sizes: Mapping[str, tuple[int, ...]]
    levels: Mapping[str, Levels]
    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    finding: str = ""


def packed(
    scene: Scene,
    images: Mapping[str, Picture],
    states: NDArray[np.float32],
    actions: NDArray[np.float32],
    finding: str = "",
) -> Packed:
    """A demonstration with its ``images``, ``(steps, height, width, 3)`` by name, compressed."""

    def png(frame: Picture) -> bytes:
        file = io.BytesIO()
        Image.fromarray(frame).save(file, "PNG")
        return file.getvalue()

    pictures = {name: list(map(png, frames)) for name, frames in images.items()}
    sizes = {name: frames.shape[1:] for name, frames in images.items()}
    counts = {name: levels(frames) for name, frames in images.items()}
    return Packed(scene, pictures, sizes, counts, states, actions, finding)


def _named(quantile: float) -> str:
    return f"q{100 * quantile:02.0f}"
