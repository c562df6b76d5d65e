"""What a camera shows of a lit surface: SAPIEN's shader, then saturation at 255."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlafuzz.worlds.manipulation.rigs.rig import Lights

Array = NDArray[np.float64]
GAMMA = 2.2
FRESNEL = 0.04  # what a material of glTF reflects head on
UP = np.array([0.0, 0.0, 1.0])


def shown(albedo: ArrayLike, normals: Array, lights: Lights, intensity: float, gloss: Array | None = None) -> Array:
    """Pixel values (n, 3) in [0, 255] of surfaces of linear ``albedo`` (n, 3) under light × ``intensity``.

    Args:
        normals: (n, 3), of length 1.
        gloss: (n,) what is reflected like a mirror: see ``glossy``; None for none.
    """
    toward, strength = _lamps(lights)
    lit = lights.ambient + np.maximum(normals @ toward.T, 0.0) @ strength / np.pi
    linear = np.asarray(albedo) * lit[:, None]
    if gloss is not None:
        linear = linear + gloss[:, None]
    return np.asarray(255 * np.minimum(linear * intensity, 1.0) ** (1 / GAMMA))


def glossy(normals: Array, to_camera: Array, roughness: float, lights: Lights) -> Array:
    """``(n,)`` light of the lamps that surfaces reflect into the camera, by the shader's GGX.

    ``normals`` and ``to_camera``: (n, 3), of length 1.
    """
    toward, strength = _lamps(lights)
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
def _lamps(lights: Lights) -> tuple[Array, Array]:
    toward = -np.array([direction for direction, _ in lights.directional])
    strength = np.array([intensity for _, intensity in lights.directional])
    return toward / np.linalg.norm(toward, axis=1, keepdims=True), strength
