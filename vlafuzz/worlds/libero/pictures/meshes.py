"""The meshes of a compiled MuJoCo model, coarser by levels: 300,000 triangles take most of a CPU's time.

The results are in the user's cache, named by a mesh's content. The model stays as it is.
"""

from __future__ import annotations

import hashlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common import assets
from vlafuzz.worlds.libero.pictures.collapse import CREASE, SHADING, Mesh, collapsed

Array = NDArray[np.float32]
VERSION = 2  # raise it when the same mesh results in other ones
LEVELS = (0.0005, 0.001, 0.002, 0.004)  # metres by which each moves the surface
SMALL = 100  # triangles that are not worth it


def shown(model: Any) -> dict[int, bool]:
    """The meshes in pictures that have ``SMALL`` triangles or more, and whether they have a texture."""
    meshes: dict[int, bool] = {}
    visible = (model.geom_group > 0) & (model.geom_type == 7)  # mjGEOM_MESH
    for mesh, material in zip(model.geom_dataid[visible], model.geom_matid[visible], strict=True):
        if model.mesh_facenum[mesh] >= SMALL:
            textured = (
                model.mesh_texcoordadr[mesh] >= 0 and material >= 0 and (model.mat_texid[material] >= 0).any()
            )
            meshes[int(mesh)] = meshes.get(int(mesh), False) or bool(textured)
    return meshes


def coarser(model: Any, mesh: int, *, textured: bool) -> list[Mesh]:
    """One mesh by ``LEVELS``. The first call for it takes a second or more."""
    parts = _corners(model, mesh, textured=textured)
    digest = hashlib.sha256(f"{VERSION} {LEVELS} {CREASE} {SHADING}".encode())
    for part in parts:
        digest.update(part.tobytes())
    folder = assets.made_once(
        f"libero/{digest.hexdigest()[:20]}",
        partial(_fill, parts),
        lambda folder: (folder / "meshes.npz").is_file(),
    )
    with np.load(folder / "meshes.npz") as kept:
        return [Mesh(*(kept[f"{level} {name}"] for name in Mesh._fields)) for level in range(len(LEVELS))]


def _corners(model: Any, mesh: int, *, textured: bool) -> tuple[Array, Array, Array]:
    """Positions and normals ``(n, 3, 3)`` and texture coordinates ``(n, 3, 2)`` of its triangles."""
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    positions = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[rows]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[rows]]
    if not textured:
        return positions, normals, np.zeros((*positions.shape[:2], 2), np.float32)
    first = model.mesh_texcoordadr[mesh]
    return positions, normals, model.mesh_texcoord[first + model.mesh_facetexcoord[rows]]


def _fill(parts: tuple[Array, Array, Array], folder: Path) -> None:
    arrays = {
        f"{level} {name}": part
        for level, mesh in enumerate(collapsed(*parts, LEVELS))
        for name, part in mesh._asdict().items()
    }
    np.savez(folder / "meshes.npz", **arrays)
