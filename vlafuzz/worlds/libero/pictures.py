"""Pictures of LIBERO's two cameras."""

import ctypes
import mmap
import sys
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Picture
from vlafuzz.model import Setting
from vlafuzz.worlds.libero.quick import QuickCanvas
from vlafuzz.worlds.opengl import Canvas

CAMERAS = ("agentview", "robot0_eye_in_hand")
QUALITY = Setting("quality", "full", ("full", "fast"))
_MOST_PIXELS = 512  # of a texture's side in a smaller model; a thing takes some fifty of a picture
_DONTNEED = 4  # of Linux's madvise


class Pictures:
    """Draws a MuJoCo model. The renderer starts with the first picture.

    Args:
        size: of a picture's sides at most, pixels.
        quality: ``full`` as robosuite does, pixel by pixel; ``fast`` nearly so: see ``quick.py``.
    """

    def __init__(self, model: Any, size: int, quality: str) -> None:
        self._model, self._size, self._quality = model, size, quality
        self._canvas: Canvas | None = None

    def take(self, data: Any, camera: str, size: int) -> Picture:
        """``(size, size, 3)`` of a camera, turned by 180° as LIBERO's models expect it."""
        canvas = self._canvas = self._canvas or self._begun()
        canvas.look(camera)
        return np.ascontiguousarray(canvas.draw(data, size, size)[::-1, ::-1])

    def close(self) -> None:
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def _begun(self) -> Canvas:
        size, fast = self._size, self._quality == "fast"
        canvas = QuickCanvas(self._model, size) if fast else Canvas(self._model, size, size)
        canvas.options.geomgroup[0] = 0  # shapes that collide
        discard(self._model.tex_data)  # the renderer has its own copy
        return canvas


def shrink(model: Any) -> None:
    """Halve a model's flat textures, most of its memory, in place until none has over 512 pixels a side.

    Each pixel becomes the mean of four, as in the smaller copies that a renderer shows from afar.
    """
    for texture in range(model.ntex):
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        while max(height, width) > _MOST_PIXELS and height % 2 == width % 2 == 0 and height <= 2 * width:
            pixels = model.tex_data[start : start + height * width * channels]
            fours = pixels.reshape(height // 2, 2, width // 2, 2, channels)
            height, width = height // 2, width // 2
            total = sum(fours[:, row, :, column].astype(np.uint16) for row in (0, 1) for column in (0, 1))
            pixels[: height * width * channels] = ((total + 2) // 4).ravel()
        model.tex_height[texture], model.tex_width[texture] = height, width


def discard(data: Picture) -> None:
    """Give the memory of pixels back to Linux, whole pages of it: what is read there later is zero."""
    if sys.platform != "linux":
        return
    start = -(-data.ctypes.data // mmap.PAGESIZE) * mmap.PAGESIZE
    length = (data.ctypes.data + data.nbytes - start) // mmap.PAGESIZE * mmap.PAGESIZE
    if length > 0:
        ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), _DONTNEED)
