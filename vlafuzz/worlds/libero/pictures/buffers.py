"""Buffers that OpenGL draws into."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.worlds.libero.packages import load


class Buffer:
    """A square of colours and depths in the current context of OpenGL, which removes it when it ends.

    Args:
        samples: of each pixel; 0 for one of the usual kind.
        mirrors: whether what is drawn may have some, which costs time.
    """

    def __init__(self, side: int, samples: int = 0, *, mirrors: bool = False) -> None:
        self._gl = gl = load("OpenGL.GL")
        self.side = side
        self._number = gl.glGenFramebuffers(1)
        self.bind()
        depth = (gl.GL_DEPTH_COMPONENT32F, gl.GL_DEPTH_ATTACHMENT)
        if mirrors:
            depth = (gl.GL_DEPTH32F_STENCIL8, gl.GL_DEPTH_STENCIL_ATTACHMENT)
        for form, place in ((gl.GL_RGBA8, gl.GL_COLOR_ATTACHMENT0), depth):
            part = gl.glGenRenderbuffers(1)
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, part)
            gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, form, side, side)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, part)

    def bind(self) -> None:
        """What is drawn from now on goes here."""
        self._gl.glBindFramebuffer(self._gl.GL_FRAMEBUFFER, self._number)

    def source(self) -> None:
        """What is copied from now on comes from here."""
        self._gl.glBindFramebuffer(self._gl.GL_READ_FRAMEBUFFER, self._number)

    def copy(self, target: Buffer, *, depths: bool = True, colours: bool = True) -> None:
        """Copy to a buffer of the same size; samples become pixels."""
        self.source()
        self._gl.glBindFramebuffer(self._gl.GL_DRAW_FRAMEBUFFER, target._number)
        copy_sources(self.side, depths=depths, colours=colours)

    def pixels(self) -> NDArray[np.uint8]:
        """``(side, side, 3)`` from the lowest row up."""
        gl = self._gl
        self.source()
        picture = np.empty((self.side, self.side, 3), np.uint8)
        gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
        gl.glReadPixels(0, 0, self.side, self.side, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, picture)
        return picture


def copy_sources(side: int, *, depths: bool = True, colours: bool = True) -> None:
    """Copy what comes from the source to where is drawn."""
    gl: Any = load("OpenGL.GL")
    what = gl.GL_COLOR_BUFFER_BIT * colours | gl.GL_DEPTH_BUFFER_BIT * depths
    gl.glBlitFramebuffer(0, 0, side, side, 0, 0, side, side, what, gl.GL_NEAREST)
