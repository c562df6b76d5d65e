"""Less memory for the textures of a compiled MuJoCo model: they are most of it."""

from __future__ import annotations

import ctypes
import mmap
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

DONTNEED = 4  # of Linux's madvise
MOST = 512  # pixels of a texture's side; a thing takes some fifty of a picture


def shrink(model: Any) -> None:
    """Halve the flat textures of a model, in place, until none is larger than ``MOST``.

    Each pixel becomes the mean of four, as in the smaller copies that a renderer shows from afar.
    """
    for texture in range(model.ntex):
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        while max(height, width) > MOST and height % 2 == width % 2 == 0 and height <= 2 * width:
            pixels = model.tex_data[start : start + height * width * channels]
            fours = pixels.reshape(height // 2, 2, width // 2, 2, channels)
            height, width = height // 2, width // 2
            total = sum(fours[:, row, :, column].astype(np.uint16) for row in (0, 1) for column in (0, 1))
            pixels[: height * width * channels] = ((total + 2) // 4).ravel()
        model.tex_height[texture], model.tex_width[texture] = height, width


def discard(data: NDArray[np.uint8]) -> None:
    """Give the memory of pixels back to the system, whole pages of it: what is read there later is zero."""
    if sys.platform != "linux":
        return
    start = -(-data.ctypes.data // mmap.PAGESIZE) * mmap.PAGESIZE
    length = (data.ctypes.data + data.nbytes - start) // mmap.PAGESIZE * mmap.PAGESIZE
    if length > 0:
        ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), DONTNEED)
