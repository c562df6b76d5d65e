"""Skin: points spread over an object's surface, with their normals and colours."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.tabletop.objects.hulls import triangles
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

Array = NDArray[np.float64]
POINTS = 400  # of which the camera sees less than half
ROUGH = 0.7  # where a pack does not say it
SRGB = 2.2  # exponent from sRGB to linear, as SAPIEN has it


@dataclass(frozen=True, eq=False)
class Skin:
    """Points that stand for equal areas, in the object's frame."""

    points: Array  # (n, 3) metres
    normals: Array  # (n, 3) outwards
    colours: Array  # (n, 3) linear
    roughness: float  # in [0, 1]


@lru_cache(maxsize=256)
def skin(model: ObjectModel) -> Skin:
    """The skin of an object: of its textured mesh, else of its convex parts in the dominant colour."""
    if model.visual.suffix == ".glb" and model.fit is None:
        return _textured(model)
    corners = np.concatenate([part[triangles(part)] for part in model.parts])
    points, face, _ = _spread(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    textured = model.visual.name.startswith("textured")  # their mean is sRGB, a plain colour linear
    colour = model.colour**SRGB if textured else model.colour
    return Skin(points, normals, np.tile(colour, (len(points), 1)), ROUGH)


def _textured(model: ObjectModel) -> Skin:
    import trimesh

    mesh: Any = trimesh.load_scene(model.visual).to_geometry()
    points, face, weights = _spread(mesh.vertices[mesh.faces])
    corners = mesh.faces[face]
    normals = (mesh.vertex_normals[corners] * weights[..., None]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    u, v = (mesh.visual.uv[corners] * weights[..., None]).sum(axis=1).T
    material = mesh.visual.material
    texture = np.asarray(material.baseColorTexture.convert("RGB")) / 255
    height, width = texture.shape[:2]
    row, column = ((1 - v) * height).astype(int) % height, (u * width).astype(int) % width
    return Skin(points, normals, texture[row, column] ** SRGB, material.roughnessFactor)


def _spread(corners: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """Points spread evenly over triangles ``(n, 3, 3)``: the points, their triangles, barycentric weights."""
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.cumsum(np.linalg.norm(sides, axis=1))
    rng = np.random.default_rng(0)
    ticks = (np.arange(POINTS) + rng.random(POINTS)) / POINTS  # stratified: every face gets its share
    face = np.minimum(np.searchsorted(areas, ticks * areas[-1]), len(areas) - 1)
    a, b = np.sqrt(rng.random(POINTS)), rng.random(POINTS)
    weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
    return (corners[face] * weights[..., None]).sum(axis=1), face, weights
