"""MuJoCo's pictures without a screen, and which OpenGL draws them here."""

from functools import cache
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Picture
from vlafuzz.common.child import tried

MOST_SHAPES = 1000  # in a picture, as in robosuite

_CHILD = """
from mujoco.egl import GLContext
context = GLContext(8, 8)
context.make_current()
from OpenGL import GL
device, version = (GL.glGetString(name).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION))
print(device, version[version.find("Mesa"):] if "Mesa" in version else f"OpenGL {version}", sep=", ")
context.free()
"""


@cache
def device() -> str:
    """Device and driver with its version; empty if no pictures can be drawn."""
    lines, problem = tried(_CHILD, MUJOCO_GL="egl")
    return "" if problem else "\n".join(lines).strip()


class Canvas:
    """Draws a MuJoCo model by EGL, whatever MuJoCo would choose, in pictures of at most this width and height.

    Attributes:
        scene, options, camera, context: MuJoCo's, for who changes what is shown or draws it himself.
    """

    def __init__(self, model: Any, width: int, height: int) -> None:
        import mujoco
        from mujoco.egl import GLContext

        self._mujoco, self._model, self._gl = mujoco, model, GLContext(width, height)
        self._gl.make_current()
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self.scene, self.options = mujoco.MjvScene(model, maxgeom=MOST_SHAPES), mujoco.MjvOption()
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self.context: Any = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.context)

    def look(self, camera: str) -> None:
        """Draw from now on what the camera of this name shows."""
        self._gl.make_current()
        self.camera.fixedcamid = self._model.camera(camera).id

    def draw(self, data: Any, width: int, height: int) -> Picture:
        """``(height, width, 3)`` from the lowest row up."""
        mujoco, everything = self._mujoco, self._mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self.options, None, self.camera, everything, self.scene)
        picture, view = np.empty((height, width, 3), dtype=np.uint8), mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, self.scene, self.context)
        mujoco.mjr_readPixels(picture, None, view, self.context)
        return picture

    def close(self) -> None:
        self._gl.make_current()
        self.context.free()
        self._gl.free()
