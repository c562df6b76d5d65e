"""Pictures of LIBERO's two cameras, its own or cheaper ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures.quick import Artist
from vlafuzz.worlds.libero.pictures.textures import discard

Image = NDArray[np.uint8]
CAMERAS = ("agentview", "robot0_eye_in_hand")
_MOST_GEOMS = 1000  # as robosuite


@dataclass(frozen=True)
class Savings:
    """How pictures are made cheaper, which a CPU draws slowly. Not at all by default: LIBERO's own pictures.

    Attributes:
        quick: whether meshes are coarser, what stands still is drawn once, and nothing mirrors what moves.
        smooth: then, pixels a side that are drawn for one of the wrist camera; 1 leaves jagged edges.
    """

    quick: bool = False
    smooth: int = 2


SAVINGS = {"none": Savings(), "coarse": Savings(quick=True), "fast": Savings(quick=True, smooth=1)}


class Pictures:
    """Draws a MuJoCo model as robosuite does, pixel by pixel. The renderer starts with the first picture.

    Args:
        size: of a picture's sides at most, pixels.
    """

    def __init__(self, model: Any, size: int, savings: Savings) -> None:
        self._mujoco = load("mujoco")
        self._model, self._size, self._savings = model, size, savings
        self._context: Any = None
        self._artist: Artist | None = None

    def take(self, data: Any, camera: str, size: int | None = None) -> Image:
        """``(size, size, 3)`` of a camera, turned by 180° as LIBERO's models expect it."""
        size = size or self._size
        if self._context is None:
            self._start()
        mujoco = self._mujoco
        self._gl.make_current()
        self._camera.fixedcamid = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if self._artist:
            return np.ascontiguousarray(self._artist.draw(data, self._camera, size)[::-1, ::-1])
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)
        picture = np.empty((size, size, 3), dtype=np.uint8)
        view = mujoco.MjrRect(0, 0, size, size)
        mujoco.mjr_render(view, self._scene, self._context)
        mujoco.mjr_readPixels(picture, None, view, self._context)
        return np.ascontiguousarray(picture[::-1, ::-1])

    def close(self) -> None:
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._context = self._artist = None

    def _start(self) -> None:
        mujoco, model = self._mujoco, self._model
        model.vis.global_.offwidth = model.vis.global_.offheight = self._size
        self._gl = load("mujoco.egl").GLContext(self._size, self._size)
        self._gl.make_current()
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[0] = 0  # shapes that collide
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        if self._savings.quick:
            self._artist = Artist(
                model, self._scene, self._options, self._context, smooth=self._savings.smooth
            )
        discard(model.tex_data)  # the renderer has its own copy
