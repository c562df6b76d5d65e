"""Textures of boxes, with one cell for each face. Lengths in metres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw

from vlafuzz.objects.canvas import Canvas, dot, rgb
from vlafuzz.objects.hulls import Array

SIDE = 512  # a face's longer side, pixels
CELL = 1 / 3


def cell(face: int, square: Array) -> Array:
    """UV of points ``(n, 2)`` in the unit square of a face: +x, -x, +y, -y, +z, -z, in rows of three."""
    margin = 0.004
    corner = np.array([face % 3 * CELL, 0.5 - face // 3 * 0.5])
    return np.asarray(corner + margin + square * (np.array([CELL, 0.5]) - 2 * margin))


def paint_box(canvas: Canvas, size: tuple[float, float, float]) -> None:
    """Paint the six faces of a box into their cells."""
    width, height = canvas.image.size
    for face in range(6):
        axis = face // 2
        wide = size[1] if axis != 1 else size[0]
        high = size[2] if axis < 2 else size[0]
        scale = SIDE / max(wide, high)
        pixels = (max(8, round(wide * scale)), max(8, round(high * scale)))
        image = Image.new("RGB", pixels, rgb(canvas.colour))
        part = Canvas(image, ImageDraw.Draw(image), canvas.colour, canvas.look)
        BOX_PAINTERS[canvas.look.pattern](part, face, 1 / scale)
        at = (round(face % 3 * width * CELL), face // 3 * height // 2)
        canvas.image.paste(image.resize((round(width * CELL) + 1, height // 2)), at)


def box_plain(canvas: Canvas, face: int, pixel: float) -> None:
    """Darker edges."""
    width, height = canvas.image.size
    canvas.draw.rectangle([0, 0, width - 1, height - 1], None, rgb(canvas.colour, 0.8), max(2, width // 24))


def box_pores(canvas: Canvas, face: int, pixel: float) -> None:
    """A sponge: pores, and a scouring pad at the bottom, visible as a stripe on the sides."""
    width, height = canvas.image.size
    for x, y, r in np.random.default_rng(11 + face).random((170, 3)):
        reach = (0.0006 + 0.0016 * r * r) / pixel
        dot(canvas.draw, x * width, y * height, reach, [0.72 * part for part in canvas.colour])
    if face != 4:
        top = 0 if face == 5 else 0.78 * height
        canvas.draw.rectangle([0, top, width, height], rgb(canvas.look.accent))


def box_stripes(canvas: Canvas, face: int, pixel: float) -> None:
    width, height = canvas.image.size
    for at in np.arange(0.012, 1.0, 0.03):
        canvas.draw.rectangle([at / pixel, 0, (at + 0.009) / pixel, height], rgb(canvas.look.accent))
    if face >= 4:
        hem = round(0.004 / pixel)
        canvas.draw.rectangle([0, 0, width - 1, height - 1], None, rgb(canvas.look.accent), hem)


def box_checks(canvas: Canvas, face: int, pixel: float) -> None:
    """Gingham: stripes in both directions, in the full colour where they cross."""
    width, height = canvas.image.size
    mix = tuple((a + b) / 2 for a, b in zip(canvas.colour, canvas.look.accent, strict=True))
    step = 0.0225 / pixel
    for i in range(int(width / step) + 1):
        for j in range(int(height / step) + 1):
            count = i % 2 + j % 2
            fill = (canvas.colour, mix, canvas.look.accent)[count]
            canvas.draw.rectangle([i * step, j * step, (i + 1) * step, (j + 1) * step], rgb(fill))


BOX_PAINTERS: dict[str, Callable[[Canvas, int, float], None]] = {
    "plain": box_plain,
    "pores": box_pores,
    "stripes": box_stripes,
    "checks": box_checks,
}
