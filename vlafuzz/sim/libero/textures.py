"""Smaller textures in a compiled MuJoCo model: most of its memory, and more than its pictures show."""

from __future__ import annotations

from typing import Any

import numpy as np

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
