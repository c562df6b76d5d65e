"""The meshes of a MuJoCo model, coarser by levels: its 300,000 triangles take most of a CPU's time.

The results are in the user's cache, named by a mesh's content. The model stays as it is.
"""

from __future__ import annotations

import hashlib
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common import assets
from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures.collapse import CREASE, SHADING, Mesh, collapsed

Array = NDArray[np.float32]
VERSION = 2  # raise it when the same mesh results in other ones
LEVELS = (0.0005, 0.001, 0.002, 0.004)  # metres by which each moves the surface
SMALL = 100  # triangles that are not worth it
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_HIDDEN = -1  # MuJoCo draws no mesh of that number


class Detail:
    """Meshes of a model in all levels of detail, as display lists of MuJoCo's renderer, which is current."""

    def __init__(self, model: Any, context: Any) -> None:
        self._model = model
        self._mesh = int(load("mujoco").mjtGeom.mjGEOM_MESH)
        meshes = _shown(model)
        # a list is called by its distance from MuJoCo's first mesh, which must not be negative
        lists = new_lists(len(meshes) * len(LEVELS), after=context.baseMesh) - context.baseMesh
        # MuJoCo keeps two lists for each mesh: itself and its convex hull
        self._lists = np.repeat(2 * np.arange(model.nmesh)[:, None], 1 + len(LEVELS), axis=1)
        for row, (mesh, textured) in enumerate(meshes.items()):
            for column, level in enumerate(_coarser(model, mesh, textured=textured)):
                number = lists + row * len(LEVELS) + column
                _record(context.baseMesh + number, level)
                self._lists[mesh, 1 + column] = number

    def choose(self, scene: Any, data: Any, camera: int, pixel: float) -> None:
        """Replace the meshes of a scene by ones that are off by ``pixel`` of a picture's height at most."""
        model = self._model
        height = 2 * np.tan(np.radians(model.cam_fovy[camera]) / 2)  # metres in a distance of one
        away = np.linalg.norm(data.geom_xpos - data.cam_xpos[camera], axis=1) - 0.5 * model.geom_rbound
        level = np.searchsorted(LEVELS, pixel * height * away, side="right")
        lists = self._lists[model.geom_dataid, level]
        lists[~self._in_view(data, camera)] = _HIDDEN
        numbers = lists.tolist()
        for geom in scene.geoms[: scene.ngeom]:
            if geom.type == self._mesh and geom.objid >= 0:
                geom.dataid = numbers[geom.objid]

    def _in_view(self, data: Any, camera: int) -> NDArray[np.bool_]:
        """Of all geoms: whether the box around them is in the camera's pyramid, or may be."""
        boxes = self._model.geom_aabb
        corners = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        corners = np.einsum("gij,gkj->gki", data.geom_xmat.reshape(-1, 3, 3), corners)
        corners += data.geom_xpos[:, None] - data.cam_xpos[camera]
        x, y, z = np.moveaxis(corners @ data.cam_xmat[camera].reshape(3, 3), -1, 0)
        reach = -z * np.tan(np.radians(self._model.cam_fovy[camera]) / 2)
        outside = (z > 0, x > reach, -x > reach, y > reach, -y > reach)
        return np.asarray(~np.any([side.all(axis=1) for side in outside], axis=0))


def new_lists(count: int, after: int) -> int:
    """The first of new display lists in a row, whose numbers are above ``after``."""
    gl = load("OpenGL.GL")
    return int(gl.glGenLists(max(count, after)))  # there is no room for as many before it


def _record(number: int, mesh: Mesh) -> None:
    """Have a display list draw a mesh."""
    gl = load("OpenGL.GL")
    parts: Any = (
        (gl.GL_VERTEX_ARRAY, gl.glVertexPointer, [3], mesh.points),
        (gl.GL_NORMAL_ARRAY, gl.glNormalPointer, [], mesh.normals),
        (gl.GL_TEXTURE_COORD_ARRAY, gl.glTexCoordPointer, [2], mesh.textures),
    )
    gl.glNewList(number, gl.GL_COMPILE)
    for state, point, width, values in parts:
        gl.glEnableClientState(state)
        point(*width, gl.GL_FLOAT, 0, values)
    gl.glDrawElements(gl.GL_TRIANGLES, mesh.triangles.size, gl.GL_UNSIGNED_INT, mesh.triangles)
    gl.glEndList()
    for state, *_ in parts:
        gl.glDisableClientState(state)


def _shown(model: Any) -> dict[int, bool]:
    """The meshes in pictures that have ``SMALL`` triangles or more, and whether they have a texture."""
    meshes: dict[int, bool] = {}
    visible = (model.geom_group > 0) & (model.geom_type == 7)  # mjGEOM_MESH
    for mesh, material in zip(model.geom_dataid[visible], model.geom_matid[visible], strict=True):
        if model.mesh_facenum[mesh] >= SMALL:
            textured = model.mesh_texcoordadr[mesh] >= 0 and material >= 0 and (model.mat_texid[material] >= 0).any()
            meshes[int(mesh)] = meshes.get(int(mesh), False) or bool(textured)
    return meshes


def _coarser(model: Any, mesh: int, *, textured: bool) -> list[Mesh]:
    """One mesh by ``LEVELS``. The first call for it takes a second or more."""
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    points = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[rows]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[rows]]
    textures = np.zeros((*points.shape[:2], 2), np.float32)
    if textured:
        textures = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + model.mesh_facetexcoord[rows]]
    parts = (points, normals, textures)
    digest = hashlib.sha256(f"{VERSION} {LEVELS} {CREASE} {SHADING}".encode())
    for part in parts:
        digest.update(part.tobytes())
    folder = assets.made_once(
        f"libero/{digest.hexdigest()[:20]}", partial(_fill, parts), lambda folder: (folder / "meshes.npz").is_file()
    )
    with np.load(folder / "meshes.npz") as kept:
        return [Mesh(*(kept[f"{level} {name}"] for name in Mesh._fields)) for level in range(len(LEVELS))]


def _fill(parts: tuple[Array, Array, Array], folder: Path) -> None:
    arrays = {
        f"{level} {name}": part
        for level, mesh in enumerate(collapsed(*parts, LEVELS))
        for name, part in mesh._asdict().items()
    }
    np.savez(folder / "meshes.npz", **arrays)
