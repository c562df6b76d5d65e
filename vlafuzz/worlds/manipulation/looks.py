"""Colours, linear, of table top, wall and floor, and what a camera shows of a lit surface."""

from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.manipulation.rigs import Lights

GAMMA = 2.2
FRESNEL = 0.04  # what a material of glTF reflects head on
UP = np.array([0.0, 0.0, 1.0])
Colour = tuple[float, float, float]
COLOUR: Colour = (0.52, 0.44, 0.36)  # mean colour of the table top
WALL_COLOUR: Colour = (0.55, 0.58, 0.56)
FLOOR_COLOUR: Colour = (0.30, 0.31, 0.33)
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


def shown(albedo: ArrayLike, normals: Array, lights: Lights, intensity: float, gloss: Array | None = None) -> Array:
    """Pixel values (n, 3) in [0, 255] of surfaces of linear ``albedo`` (n, 3) under light × ``intensity``.

    By SAPIEN's shader, then saturation at 255.

    Args:
        normals: (n, 3), of length 1.
        gloss: (n,) what is reflected like a mirror: see ``glossy``; None for none.
    """
    toward, strength = lamps_of(lights)
    lit = lights.ambient + np.maximum(normals @ toward.T, 0.0) @ strength / np.pi
    linear = np.asarray(albedo) * lit[:, None]
    if gloss is not None:
        linear = linear + gloss[:, None]
    return np.asarray(255 * np.minimum(linear * intensity, 1.0) ** (1 / GAMMA))


def glossy(normals: Array, to_camera: Array, roughness: float, lights: Lights) -> Array:
    """``(n,)`` light of the lamps that surfaces reflect into the camera, by the shader's GGX.

    ``normals`` and ``to_camera``: (n, 3), of length 1.
    """
    toward, strength = lamps_of(lights)
    alpha = roughness**2
    k = (alpha + 2 * roughness + 1) / 8
    halves = to_camera[:, None] + toward
    halves /= np.linalg.norm(halves, axis=2, keepdims=True)
    light, eye = np.clip(normals @ toward.T, 0, 1), np.clip((normals * to_camera).sum(axis=1), 1e-6, 1)
    half = np.clip(np.einsum("nc,nlc->nl", normals, halves), 1e-6, 1)
    across = np.clip(np.einsum("nc,nlc->nl", to_camera, halves), 1e-6, 1)
    fresnel = FRESNEL + (1 - FRESNEL) * 2.0 ** ((-5.55473 * across - 6.98316) * across)
    spread = (half**2 * (alpha**2 - 1) + 1) ** 2
    shadowed = (eye * (1 - k) + k)[:, None] * (light * (1 - k) + k)
    bright = fresnel * alpha**2 / np.clip(4 * np.pi * spread * shadowed, 1e-6, 4 * np.pi) * light
    return np.asarray(bright @ strength)


@lru_cache(maxsize=32)
def lamps_of(lights: Lights) -> tuple[Array, Array]:
    """Directions ``(n, 3)`` towards the lamps, of length 1, and their strengths ``(n,)``."""
    toward = -np.array([direction for direction, _ in lights.directional])
    strength = np.array([intensity for _, intensity in lights.directional])
    return toward / np.linalg.norm(toward, axis=1, keepdims=True), strength


def on_table(lights: Lights) -> float:
    """The light that a level surface reflects, relative to its albedo."""
    toward, strength = lamps_of(lights)
    return float(lights.ambient + toward[:, 2] @ strength / np.pi)


def planks(size: int = 256) -> Array:
    """``(size, size)`` shades of planks with grain."""
    rng = np.random.default_rng(3)
    tone = rng.normal(0.0, 0.045, _PLANKS).repeat(-(-size // _PLANKS))[:size, None]
    along = np.cumsum(rng.normal(0.0, 1.0, (size, size)), axis=1)
    grain = (along - along.mean(axis=1, keepdims=True)) / along.std() * 0.02 + rng.normal(0, 0.02, (size, 1))
    seams = np.where(np.arange(size) % (-(-size // _PLANKS)) < 2, -0.16, 0.0)[:, None]
    return np.asarray(1.0 + tone + grain + seams)


def shade(pattern: str, size: int = 256) -> Array:
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
