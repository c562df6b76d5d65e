"""Pictures of LIBERO's two cameras for a CPU, several times as fast as LIBERO's own and nearly the same.

What stands still before a camera that stands still is drawn once, as LIBERO draws it. Meshes are as coarse as
a pixel allows. For a camera that moves, edges are smoothed by drawing several pixels for one, which costs
less than LIBERO's samples. A picture depends on nothing but the state, as LIBERO's own do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures.buffers import Buffer, copy_sources
from vlafuzz.worlds.libero.pictures.detail import Detail, new_lists

Image = NDArray[np.uint8]
SAMPLES = 4  # of a pixel in LIBERO's own pictures
STILL, MOVING = 0.6, 0.75  # pixels by which meshes may be off before a camera that stands still or moves


@dataclass
class _Still:
    """What stands still before a camera: a buffer, a display list that copies it, and what it shows."""

    kept: Buffer
    copying: int
    shows: bytes = b""


class Artist:
    """Draws a MuJoCo model into a context of its renderer, which is current.

    Args:
        smooth: pixels a side that are drawn for one where the camera moves.
    """

    def __init__(self, model: Any, scene: Any, options: Any, context: Any, *, smooth: int) -> None:
        self._mujoco, self._gl = load("mujoco"), load("OpenGL.GL")
        self._parts = self._mujoco.mjtCatBit
        self._model, self._scene, self._options, self._context = model, scene, options, context
        self._smooth = smooth
        self._detail = Detail(model, context)
        self._buffers: dict[tuple[int, int], Buffer] = {}
        self._stills: dict[tuple[int, int], _Still] = {}
        self._resting = model.body_weldid[model.geom_bodyid] == 0
        scene.flags[self._mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # LIBERO's lamps cast none

    def draw(self, data: Any, view: Any, size: int) -> Image:
        """``(size, size, 3)`` of a fixed camera of the model, from the lowest row up."""
        camera = view.fixedcamid
        if self._model.body_weldid[self._model.cam_bodyid[camera]] == 0:
            return self._before_still(data, view, size)
        factor = self._smooth
        buffer = self._buffer(size * factor)
        # what moves comes first: it is near, and nothing is computed of what it hides
        self._arrange(data, view, self._parts.mjCAT_DYNAMIC)
        self._add(data, self._parts.mjCAT_STATIC)
        self._detail.choose(self._scene, data, camera, MOVING / size)
        self._render(buffer, mirrors=False, sky=True, sharper=factor)
        picture = buffer.pixels()
        return picture if factor == 1 else np.asarray(Pillow.fromarray(picture).reduce(factor))

    def _before_still(self, data: Any, view: Any, size: int) -> Image:
        """What moves, drawn before what stands still."""
        mujoco, scene = self._mujoco, self._scene
        still = self._stills.get((view.fixedcamid, size))
        if still is None:
            still = self._stills[view.fixedcamid, size] = self._new_still(size)
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
        self._render(buffer, mirrors=False, sky=False, source=still.kept)
        return buffer.pixels()

    def _draw_still(self, kept: Buffer, data: Any, view: Any) -> None:
        """Colours as LIBERO draws them, with several samples a pixel; depths in the middle of each pixel."""
        buffer = self._buffer(kept.side)
        self._arrange(data, view, self._parts.mjCAT_STATIC)
        self._render(buffer, mirrors=False, sky=False)
        buffer.copy(kept, colours=False)
        sampled = self._buffer(kept.side, SAMPLES)
        self._render(sampled, mirrors=True, sky=True)
        sampled.copy(kept, depths=False)

    def _arrange(self, data: Any, view: Any, parts: int) -> None:
        """Begin a scene with what rests or moves."""
        self._mujoco.mjv_updateScene(self._model, data, self._options, None, view, parts, self._scene)

    def _add(self, data: Any, parts: int) -> None:
        nothing = self._mujoco.MjvPerturb()
        self._mujoco.mjv_addGeoms(self._model, data, self._options, nothing, parts, self._scene)

    def _render(
        self, target: Buffer, *, mirrors: bool, sky: bool, sharper: int = 1, source: Buffer | None = None
    ) -> None:
        """Draw the scene; ``sharper``: pixels a side that will be one, for which textures are no finer."""
        gl, flags = self._gl, self._mujoco.mjtRndFlag
        self._scene.flags[flags.mjRND_REFLECTION] = mirrors
        self._scene.flags[flags.mjRND_SKYBOX] = sky
        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glTexEnvf(gl.GL_TEXTURE_FILTER_CONTROL, gl.GL_TEXTURE_LOD_BIAS, np.log2(sharper))
        target.bind()
        if source is not None:
            source.source()
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
        number = new_lists(1, after=self._context.baseMesh)
        self._gl.glNewList(number, self._gl.GL_COMPILE)
        copy_sources(size)
        self._gl.glEndList()
        return _Still(Buffer(size), number - self._context.baseMesh)

    def _buffer(self, side: int, samples: int = 0) -> Buffer:
        if (side, samples) not in self._buffers:
            self._buffers[side, samples] = Buffer(side, samples, mirrors=samples > 0)
        return self._buffers[side, samples]
