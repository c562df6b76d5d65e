"""Coarser meshes in a compiled MuJoCo model: 300,000 triangles take most of a picture's time on a CPU.

Only meshes are changed that nothing collides with, so that physics keeps every bit. They stay in the arrays
of the model, which hold fewer triangles then; the result is in the user's cache, named by a mesh's content.
"""

from __future__ import annotations

import hashlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz import assets

Array = NDArray[np.float32]
VERSION = 1  # raise it when the same mesh results in another one
FACES = 0.1  # share that is kept
LARGE_FACES = 0.4  # the same for furniture and rooms, whose textures fill pictures
LARGE = 0.5  # metres
FEWEST = 2000  # triangles that a mesh keeps


def lighten(model: Any) -> None:
    """Make the visual meshes of a model coarser, in place. The first call for a mesh takes a second."""
    colliding = {
        int(mesh)
        for mesh, contype, affinity in zip(
            model.geom_dataid, model.geom_contype, model.geom_conaffinity, strict=True
        )
        if contype or affinity
    }
    for mesh in range(model.nmesh):
        if mesh not in colliding and model.mesh_facenum[mesh] > FEWEST:
            _replace(model, mesh, _coarse(*_corners(model, mesh)))


def _corners(model: Any, mesh: int) -> tuple[Array, Array, Array]:
    """Positions and normals ``(n, 3, 3)`` and texture coordinates ``(n, 3, 2)`` of its triangles."""
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    positions = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[rows]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[rows]]
    first = model.mesh_texcoordadr[mesh]
    if first < 0:
        return positions, normals, np.zeros((*positions.shape[:2], 2), np.float32)
    return positions, normals, model.mesh_texcoord[first + model.mesh_facetexcoord[rows]]


def _replace(model: Any, mesh: int, corners: tuple[Array, Array, Array]) -> None:
    positions, normals, textures = (part.reshape(-1, part.shape[-1]) for part in corners)
    count = len(positions)
    textured = model.mesh_texcoordadr[mesh] >= 0
    rooms = [model.mesh_vertnum[mesh], model.mesh_normalnum[mesh]]
    if count > min(rooms + ([model.mesh_texcoordnum[mesh]] if textured else [])):
        return  # no room for it
    indices = np.arange(count, dtype=np.int32).reshape(-1, 3)
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + len(indices))
    for array, first, values in (
        (model.mesh_vert, model.mesh_vertadr[mesh], positions),
        (model.mesh_normal, model.mesh_normaladr[mesh], normals),
    ):
        array[first : first + count] = values
    model.mesh_face[rows] = model.mesh_facenormal[rows] = indices
    if textured:
        first = model.mesh_texcoordadr[mesh]
        model.mesh_texcoord[first : first + count] = textures
        model.mesh_facetexcoord[rows] = indices
    model.mesh_facenum[mesh] = len(indices)


def _coarse(positions: Array, normals: Array, textures: Array) -> tuple[Array, Array, Array]:
    digest = hashlib.sha256(f"{VERSION} {FACES} {LARGE_FACES} {LARGE} {FEWEST}".encode())
    for part in (positions, normals, textures):
        digest.update(part.tobytes())
    fill = partial(_fill, positions, normals, textures)
    folder = assets.made_once(
        f"libero/{digest.hexdigest()[:20]}", fill, lambda folder: (folder / "mesh.npz").is_file()
    )
    with np.load(folder / "mesh.npz") as kept:
        return kept["positions"], kept["normals"], kept["textures"]


def _fill(positions: Array, normals: Array, textures: Array, folder: Path) -> None:
    import fast_simplification

    vertices, indices = np.unique(positions.reshape(-1, 3), axis=0, return_inverse=True)
    large = float(np.ptp(vertices, axis=0).max()) > LARGE
    wanted = max(int((LARGE_FACES if large else FACES) * len(positions)), FEWEST)
    points, faces = fast_simplification.simplify(
        vertices, indices.reshape(-1, 3).astype(np.int32), target_count=wanted
    )
    coarse = np.asarray(points, np.float32)[faces]
    new_normals, new_textures = _dressed(coarse, positions, normals, textures)
    np.savez(folder / "mesh.npz", positions=coarse, normals=new_normals, textures=new_textures)


def _dressed(coarse: Array, positions: Array, normals: Array, textures: Array) -> tuple[Array, Array]:
    """Normals and texture coordinates for the corners of coarse triangles.

    A corner takes those of the nearest triangle of the original that faces the same way and lies on the same
    piece of the texture as its own triangle's middle: across a seam, neighbours have unrelated coordinates.
    """
    from scipy.spatial import cKDTree

    pieces = _pieces(positions, textures)
    size = float(np.ptp(positions.reshape(-1, 3), axis=0).max()) or 1.0
    middles, facing = _described(positions, size)
    _, nearest = cKDTree(np.concatenate([middles, facing], axis=1)).query(
        np.concatenate(_described(coarse, size), axis=1)
    )
    # pieces are kept apart by a coordinate of their own
    apart = 10.0
    places = np.concatenate(
        [
            positions.reshape(-1, 3) / size,
            0.1 * normals.reshape(-1, 3),
            apart * np.repeat(pieces, 3)[:, None],
        ],
        axis=1,
    )
    directions = np.repeat(_described(coarse, size)[1], 3, axis=0)
    wanted = np.concatenate(
        [coarse.reshape(-1, 3) / size, directions, apart * np.repeat(pieces[nearest], 3)[:, None]], axis=1
    )
    _, taken = cKDTree(places).query(wanted)
    shares = _barycentric(coarse.reshape(-1, 3), positions[taken // 3])
    new_textures = np.einsum("nc,ncd->nd", shares, textures[taken // 3])
    return normals.reshape(-1, 3)[taken].reshape(coarse.shape), new_textures.reshape(*coarse.shape[:2], 2)


def _barycentric(points: Array, triangles: Array) -> Array:
    """``(n, 3)`` shares of each triangle's corners in a point, which may be a triangle's size outside."""
    origin = triangles[:, 0]
    first, second, offset = triangles[:, 1] - origin, triangles[:, 2] - origin, points - origin
    a, b, c = (np.einsum("nd,nd->n", u, v) for u, v in ((first, first), (first, second), (second, second)))
    d, e = (np.einsum("nd,nd->n", offset, side) for side in (first, second))
    area = np.maximum(a * c - b * b, 1e-20)
    shares = np.stack([(c * d - b * e) / area, (a * e - b * d) / area], axis=1).clip(-1.0, 2.0)
    return np.concatenate([1.0 - shares.sum(axis=1, keepdims=True), shares], axis=1)


def _described(triangles: Array, size: float) -> tuple[Array, Array]:
    """Middle, relative to the mesh's size, and a tenth of the unit normal of each triangle."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return triangles.mean(axis=1) / size, 0.1 * across / np.maximum(length, 1e-12)


def _pieces(positions: Array, textures: Array) -> NDArray[np.int64]:
    """``(n,)`` which piece of the texture each triangle lies on."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    places = np.concatenate([positions.reshape(-1, 3), textures.reshape(-1, 2)], axis=1)
    _, index = np.unique(places, axis=0, return_inverse=True)
    first, second, third = index.reshape(-1, 3).T
    count = int(index.max()) + 1
    rows, columns = np.concatenate([first, second]), np.concatenate([second, third])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels[first], np.int64)
