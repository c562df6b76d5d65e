"""Pictures of LIBERO's two cameras for a CPU, several times as fast as LIBERO's own and nearly the same.

What stands still before a camera that stands still is drawn once, as LIBERO draws it. Meshes are as coarse as a pixel
allows. For a camera that moves, edges are smoothed by drawing several pixels for one, which costs less than LIBERO's
samples. A picture depends on nothing but the state, as LIBERO's own do.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from vlafuzz.worlds.libero.collapse import Mesh, collapsed
from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.opengl import Canvas

Image = NDArray[np.uint8]
SAMPLES = 4  # of a pixel in LIBERO's own pictures
SMOOTH = 2  # pixels a side that are drawn for one where the camera moves
STILL, MOVING = 0.9, 1.1  # pixels by which meshes may be off before a camera that stands still or moves
Array = NDArray[np.float32]
LEVELS = (0.00075, 0.0015, 0.003, 0.006)  # metres by which each may move the surface
SMALL = 100  # triangles that are not worth it
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_HIDDEN = -1  # MuJoCo draws no mesh of that number


class _Buffer:
    """A square of colours and depths in the current context of OpenGL, which removes it when it ends.

    ``samples`` of each pixel; 0 for one of the usual kind, in which nothing is mirrored.
    """

    def __init__(self, side: int, samples: int = 0) -> None:
        self._gl = gl = load("OpenGL.GL")
        self.side = side
        self._number = gl.glGenFramebuffers(1)
        self.bind(gl.GL_FRAMEBUFFER)
        depth = (gl.GL_DEPTH_COMPONENT32F, gl.GL_DEPTH_ATTACHMENT)
        if samples:
            depth = (gl.GL_DEPTH32F_STENCIL8, gl.GL_DEPTH_STENCIL_ATTACHMENT)
        for form, place in ((gl.GL_RGBA8, gl.GL_COLOR_ATTACHMENT0), depth):
            part = gl.glGenRenderbuffers(1)
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, part)
            gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, form, side, side)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, part)

    def bind(self, role: int) -> None:
        """Draw here, copy from here, or both."""
        self._gl.glBindFramebuffer(role, self._number)

    def copy(self, target: Self, what: int) -> None:
        """Copy colours or depths to a buffer of the same size; samples become pixels."""
        self.bind(self._gl.GL_READ_FRAMEBUFFER)
        target.bind(self._gl.GL_DRAW_FRAMEBUFFER)
        _copy(self._gl, self.side, what)

    def pixels(self) -> Image:
        """``(side, side, 3)`` from the lowest row up."""
        gl = self._gl
        self.bind(gl.GL_READ_FRAMEBUFFER)
        picture = np.empty((self.side, self.side, 3), np.uint8)
        gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
        gl.glReadPixels(0, 0, self.side, self.side, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, picture)
        return picture


@dataclass
class _Still:
    """The picture of what stands still: its buffer, a display list that copies it, and what it depends on."""

    kept: _Buffer
    copying: int
    shows: bytes = b""


class QuickCanvas(Canvas):
    """A canvas on which square pictures are drawn in that way."""

    def __init__(self, model: Any, size: int) -> None:
        super().__init__(model, size, size)
        self._opengl, self._parts = load("OpenGL.GL"), self._mujoco.mjtCatBit
        self._detail = Detail(model, self.context)
        self._buffers: dict[tuple[int, int], _Buffer] = {}
        self._stills: dict[tuple[int, int], _Still] = {}
        self._resting = model.body_weldid[model.geom_bodyid] == 0
        self.scene.flags[self._mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # LIBERO's lamps cast none

    def draw(self, data: Any, width: int, height: int) -> Image:
        size, camera = width, self.camera.fixedcamid
        if self._model.body_weldid[self._model.cam_bodyid[camera]] == 0:
            return self._before_still(data, size)
        buffer = self._buffer(size * SMOOTH)
        # what moves comes first: it is near, and nothing is computed of what it hides
        self._arrange(data, self._parts.mjCAT_DYNAMIC)
        self._add(data, self._parts.mjCAT_STATIC)
        self._detail.choose(self.scene, data, camera, MOVING / size)
        self._render(buffer, sky=True, finer=SMOOTH)
        return np.asarray(Pillow.fromarray(buffer.pixels()).reduce(SMOOTH))

    def _before_still(self, data: Any, size: int) -> Image:
        """Draw what moves before the picture of what stands still."""
        mujoco, scene, camera = self._mujoco, self.scene, self.camera.fixedcamid
        still = self._stills[camera, size] = self._stills.get((camera, size)) or self._new_still(size)
        if (shows := self._seen_still(data, camera)) != still.shows:
            self._draw_still(still.kept, data)
            still.shows = shows
        self._arrange(data, 0)
        scene.ngeom = 1
        first, nowhere = scene.geoms[0], np.zeros(3)
        white = np.ones(4, np.float32)
        mujoco.mjv_initGeom(first, mujoco.mjtGeom.mjGEOM_MESH, nowhere, nowhere, np.eye(3).ravel(), white)
        first.dataid, first.objid = still.copying, -1
        self._add(data, self._parts.mjCAT_DYNAMIC)
        self._detail.choose(scene, data, camera, STILL / size)
        buffer = self._buffer(size)
        self._render(buffer, source=still.kept)
        return buffer.pixels()

    def _draw_still(self, kept: _Buffer, data: Any) -> None:
        """Draw what stands still: colours with several samples a pixel, as LIBERO does, depths at their middles."""
        plain, sampled = self._buffer(kept.side), self._buffer(kept.side, SAMPLES)
        self._arrange(data, self._parts.mjCAT_STATIC)
        self._render(plain)
        plain.copy(kept, self._opengl.GL_DEPTH_BUFFER_BIT)
        self._render(sampled, mirror=True, sky=True)
        sampled.copy(kept, self._opengl.GL_COLOR_BUFFER_BIT)

    def _arrange(self, data: Any, parts: int) -> None:
        self._mujoco.mjv_updateScene(self._model, data, self.options, None, self.camera, parts, self.scene)

    def _add(self, data: Any, parts: int) -> None:
        nothing = self._mujoco.MjvPerturb()
        self._mujoco.mjv_addGeoms(self._model, data, self.options, nothing, parts, self.scene)

    def _render(
        self, target: _Buffer, *, mirror: bool = False, sky: bool = False, finer: int = 1, source: _Buffer | None = None
    ) -> None:
        """Draw the scene; ``finer``: pixels a side that will be one, whose size textures are chosen for."""
        gl, flags = self._opengl, self._mujoco.mjtRndFlag
        self.scene.flags[flags.mjRND_REFLECTION] = mirror
        self.scene.flags[flags.mjRND_SKYBOX] = sky
        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glTexEnvf(gl.GL_TEXTURE_FILTER_CONTROL, gl.GL_TEXTURE_LOD_BIAS, np.log2(finer))
        target.bind(gl.GL_FRAMEBUFFER)
        if source is not None:
            source.bind(gl.GL_READ_FRAMEBUFFER)
        view = self._mujoco.MjrRect(0, 0, target.side, target.side)
        self._mujoco.mjr_render(view, self.scene, self.context)

    def _seen_still(self, data: Any, camera: int) -> bytes:
        """Everything that the picture of what stands still depends on."""
        model, head = self._model, self._model.vis.headlight
        parts = [data.cam_xpos[camera], data.cam_xmat[camera], data.light_xpos, data.light_xdir]
        parts += [data.geom_xpos[self._resting], data.geom_xmat[self._resting]]
        parts += [model.geom_rgba, model.site_rgba, model.mat_rgba]
        parts += [model.light_ambient, model.light_diffuse, model.light_specular]
        parts += [head.ambient, head.diffuse, head.specular]
        return b"".join(part.tobytes() for part in parts)

    def _new_still(self, size: int) -> _Still:
        """A mesh's display list may copy a buffer, too: so it happens after MuJoCo has emptied the target."""
        gl, number = self._opengl, new_lists(1, after=self.context.baseMesh)
        gl.glNewList(number, gl.GL_COMPILE)
        _copy(gl, size, gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glEndList()
        return _Still(_Buffer(size), number - self.context.baseMesh)

    def _buffer(self, side: int, samples: int = 0) -> _Buffer:
        if (side, samples) not in self._buffers:
            self._buffers[side, samples] = _Buffer(side, samples)
        return self._buffers[side, samples]


def _copy(gl: Any, side: int, what: int) -> None:
    gl.glBlitFramebuffer(0, 0, side, side, 0, 0, side, side, what, gl.GL_NEAREST)


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
        """Whether the box around each geom is in the camera's pyramid, or may be."""
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
    """One mesh by ``LEVELS``, in half a second where it is large."""
    rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    points = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[rows]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[rows]]
    textures = np.zeros((*points.shape[:2], 2), np.float32)
    if textured:
        textures = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + model.mesh_facetexcoord[rows]]
    return list(collapsed(points, normals, textures, LEVELS))
