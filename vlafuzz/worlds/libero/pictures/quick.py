"""Pictures of LIBERO's two cameras for a CPU, several times as fast as LIBERO's own and nearly the same.

What stands still before a camera that stands still is drawn once, as LIBERO draws it. Meshes are as coarse as a pixel
allows. For a camera that moves, edges are smoothed by drawing several pixels for one, which costs less than LIBERO's
samples. A picture depends on nothing but the state, as LIBERO's own do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures.meshes import Detail, new_lists

Image = NDArray[np.uint8]
SAMPLES = 4  # of a pixel in LIBERO's own pictures
SMOOTH = 2  # pixels a side that are drawn for one where the camera moves
STILL, MOVING = 0.6, 0.75  # pixels by which meshes may be off before a camera that stands still or moves


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

    def copy(self, target: _Buffer, what: int) -> None:
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
    """What stands still before a camera: a buffer, a display list that copies it, and what it shows."""

    kept: _Buffer
    copying: int
    shows: bytes = b""


class Artist:
    """Draws a MuJoCo model into a context of its renderer, which is current."""

    def __init__(self, model: Any, scene: Any, options: Any, context: Any) -> None:
        self._mujoco, self._gl = load("mujoco"), load("OpenGL.GL")
        self._parts = self._mujoco.mjtCatBit
        self._model, self._scene, self._options, self._context = model, scene, options, context
        self._detail = Detail(model, context)
        self._buffers: dict[tuple[int, int], _Buffer] = {}
        self._stills: dict[tuple[int, int], _Still] = {}
        self._resting = model.body_weldid[model.geom_bodyid] == 0
        scene.flags[self._mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # LIBERO's lamps cast none

    def draw(self, data: Any, view: Any, size: int) -> Image:
        """``(size, size, 3)`` of a fixed camera of the model, from the lowest row up."""
        camera = view.fixedcamid
        if self._model.body_weldid[self._model.cam_bodyid[camera]] == 0:
            return self._before_still(data, view, size)
        buffer = self._buffer(size * SMOOTH)
        # what moves comes first: it is near, and nothing is computed of what it hides
        self._arrange(data, view, self._parts.mjCAT_DYNAMIC)
        self._add(data, self._parts.mjCAT_STATIC)
        self._detail.choose(self._scene, data, camera, MOVING / size)
        self._render(buffer, sky=True, sharper=SMOOTH)
        return np.asarray(Pillow.fromarray(buffer.pixels()).reduce(SMOOTH))

    def _before_still(self, data: Any, view: Any, size: int) -> Image:
        """What moves, drawn before what stands still."""
        mujoco, scene, key = self._mujoco, self._scene, (view.fixedcamid, size)
        still = self._stills[key] = self._stills.get(key) or self._new_still(size)
        if (shows := self._seen_still(data, view.fixedcamid)) != still.shows:
            self._draw_still(still.kept, data, view)
            still.shows = shows
        self._arrange(data, view, 0)
        scene.ngeom = 1
        first, nowhere = scene.geoms[0], np.zeros(3)
        white = np.ones(4, np.float32)
        mujoco.mjv_initGeom(first, mujoco.mjtGeom.mjGEOM_MESH, nowhere, nowhere, np.eye(3).ravel(), white)
        first.dataid, first.objid = still.copying, -1
        self._add(data, self._parts.mjCAT_DYNAMIC)
        self._detail.choose(scene, data, view.fixedcamid, STILL / size)
        buffer = self._buffer(size)
        self._render(buffer, source=still.kept)
        return buffer.pixels()

    def _draw_still(self, kept: _Buffer, data: Any, view: Any) -> None:
        """Colours as LIBERO draws them, with several samples a pixel; depths in the middle of each pixel."""
        plain, sampled = self._buffer(kept.side), self._buffer(kept.side, SAMPLES)
        self._arrange(data, view, self._parts.mjCAT_STATIC)
        self._render(plain)
        plain.copy(kept, self._gl.GL_DEPTH_BUFFER_BIT)
        self._render(sampled, mirrors=True, sky=True)
        sampled.copy(kept, self._gl.GL_COLOR_BUFFER_BIT)

    def _arrange(self, data: Any, view: Any, parts: int) -> None:
        """Begin a scene with what rests or moves."""
        self._mujoco.mjv_updateScene(self._model, data, self._options, None, view, parts, self._scene)

    def _add(self, data: Any, parts: int) -> None:
        nothing = self._mujoco.MjvPerturb()
        self._mujoco.mjv_addGeoms(self._model, data, self._options, nothing, parts, self._scene)

    def _render(
        self,
        target: _Buffer,
        *,
        mirrors: bool = False,
        sky: bool = False,
        sharper: int = 1,
        source: _Buffer | None = None,
    ) -> None:
        """Draw the scene; ``sharper``: pixels a side that will be one, for which textures are no finer."""
        gl, flags = self._gl, self._mujoco.mjtRndFlag
        self._scene.flags[flags.mjRND_REFLECTION] = mirrors
        self._scene.flags[flags.mjRND_SKYBOX] = sky
        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glTexEnvf(gl.GL_TEXTURE_FILTER_CONTROL, gl.GL_TEXTURE_LOD_BIAS, np.log2(sharper))
        target.bind(gl.GL_FRAMEBUFFER)
        if source is not None:
            source.bind(gl.GL_READ_FRAMEBUFFER)
        view = self._mujoco.MjrRect(0, 0, target.side, target.side)
        self._mujoco.mjr_render(view, self._scene, self._context)

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
        gl, number = self._gl, new_lists(1, after=self._context.baseMesh)
        gl.glNewList(number, gl.GL_COMPILE)
        _copy(gl, size, gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glEndList()
        return _Still(_Buffer(size), number - self._context.baseMesh)

    def _buffer(self, side: int, samples: int = 0) -> _Buffer:
        if (side, samples) not in self._buffers:
            self._buffers[side, samples] = _Buffer(side, samples)
        return self._buffers[side, samples]


def _copy(gl: Any, side: int, what: int) -> None:
    """Copy between the buffers that are bound for it."""
    gl.glBlitFramebuffer(0, 0, side, side, 0, 0, side, side, what, gl.GL_NEAREST)
