"""Pictures of LIBERO's two cameras, its own or cheaper ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.sim.libero.meshes import lighten
from vlafuzz.sim.libero.packages import load

Image = NDArray[np.uint8]
CAMERAS = ("agentview", "robot0_eye_in_hand")
_MOST_GEOMS = 1000  # as robosuite


@dataclass(frozen=True)
class Savings:
    """What is left out of pictures, which a CPU draws slowly. Nothing by default: LIBERO's own pictures.

    Attributes:
        meshes: whether meshes are coarser.
        edges: whether edges are jagged: one sample a pixel instead of four.
        reflections: whether nothing mirrors.
    """

    meshes: bool = False
    edges: bool = False
    reflections: bool = False


# By name: structural similarity of ``coarse`` to LIBERO's pictures is at least 0.95, of ``fast`` about 0.92.
SAVINGS = {
    "none": Savings(),
    "coarse": Savings(meshes=True),
    "fast": Savings(meshes=True, edges=True, reflections=True),
}


class Pictures:
    """Draws a MuJoCo model as robosuite does, pixel by pixel. The renderer starts with the first picture.

    Args:
        size: of a picture's sides at most, pixels.
    """

    def __init__(self, model: Any, size: int, savings: Savings) -> None:
        self._mujoco = load("mujoco")
        self._model, self._size, self._savings = model, size, savings
        self._context: Any = None

    def take(self, data: Any, camera: str, size: int | None = None) -> Image:
        """``(size, size, 3)`` of a camera, turned by 180° as LIBERO's models expect it."""
        size = size or self._size
        if self._context is None:
            self._start()
        mujoco = self._mujoco
        self._gl.make_current()
        self._camera.fixedcamid = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
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
            self._context = None

    def _start(self) -> None:
        mujoco, model = self._mujoco, self._model
        if self._savings.meshes:
            lighten(model)
        if self._savings.edges:
            model.vis.quality.offsamples = 0
        model.vis.global_.offwidth = model.vis.global_.offheight = self._size
        self._gl = load("mujoco.egl").GLContext(self._size, self._size)
        self._gl.make_current()
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = not self._savings.reflections
        self._options = mujoco.MjvOption()
        self._options.geomgroup[0] = 0  # shapes that collide
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
