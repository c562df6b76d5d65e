"""Colours and patterns of table top, wall and floor. Colours are linear."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float]
COLOUR: Colour = (0.52, 0.44, 0.36)  # mean colour of the table top
WALL_COLOUR: Colour = (0.55, 0.58, 0.56)
FLOOR_COLOUR: Colour = (0.30, 0.31, 0.33)
WALL = -1.6  # x, behind the robot, metres
PAINTS: dict[str, Colour] = {
    "oak": COLOUR,
    "sage": WALL_COLOUR,
    "white": (0.80, 0.80, 0.76),
    "grey": (0.32, 0.32, 0.32),
    "black": (0.05, 0.05, 0.06),
    "red": (0.42, 0.12, 0.10),
    "green": (0.16, 0.33, 0.18),
    "blue": (0.12, 0.22, 0.40),
}
_PLANKS = 7  # across the depth of the table


def planks(size: int = 256) -> NDArray[np.float64]:
    """``(size, size)`` shades of planks with grain."""
    rng = np.random.default_rng(3)
    tone = rng.normal(0.0, 0.045, _PLANKS).repeat(-(-size // _PLANKS))[:size, None]
    along = np.cumsum(rng.normal(0.0, 1.0, (size, size)), axis=1)
    grain = (along - along.mean(axis=1, keepdims=True)) / along.std() * 0.02 + rng.normal(0, 0.02, (size, 1))
    seams = np.where(np.arange(size) % (-(-size // _PLANKS)) < 2, -0.16, 0.0)[:, None]
    return np.asarray(1.0 + tone + grain + seams)


def shade(pattern: str, size: int = 256) -> NDArray[np.float64]:
    """``(size, size)`` shades of a pattern, about 1."""
    if pattern == "planks":
        return planks(size)
    row, column = np.indices((size, size)) * 16 // size
    if pattern == "checker":
        return np.where((row + column) % 2, 1.3, 0.7)
    if pattern == "stripes":
        return np.where(row % 2, 1.3, 0.7)
    if pattern == "speckle":
        spots = np.random.default_rng(11).random((size // 4, size // 4)) < 0.15
        return np.where(spots, 0.5, 1.1).repeat(4, axis=0).repeat(4, axis=1)
    return np.ones((size, size))


@cache
def tones(pattern: str) -> tuple[float, ...]:
    """The shades of which most of a pattern consists, relative to its mean."""
    shades = shade(pattern)
    common = np.quantile(shades / shades.mean(), [0.1, 0.5, 0.9]).round(3)
    return tuple(np.unique(common).tolist())
