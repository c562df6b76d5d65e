"""Canvas, and drawing functions for all painters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vlafuzz.objects.schema import Colour, Look


class Canvas(NamedTuple):
    """A picture being drawn, with the object's base colour and look."""

    image: Image.Image
    draw: ImageDraw.ImageDraw
    colour: Colour
    look: Look


def rgb(colour: Iterable[float], shade: float = 1.0) -> tuple[int, int, int]:
    """SRGB in [0, 1], scaled by ``shade``, as bytes."""
    red, green, blue = (min(255, max(0, round(255 * part * shade))) for part in colour)
    return red, green, blue


def write(draw: ImageDraw.ImageDraw, word: str, box: tuple[float, float, float, float], ink: Colour) -> None:
    """Write centred lines of text as large as fits into a box (left, top, right, bottom)."""
    left, top, right, bottom = box
    size = 200
    while True:
        font = ImageFont.load_default(size)
        bold = max(1, size // 22)
        gap = size // 8
        x, y, x2, y2 = draw.multiline_textbbox(
            (0, 0), word, font, spacing=gap, align="center", stroke_width=bold
        )
        if (x2 - x <= right - left and y2 - y <= bottom - top) or size <= 10:
            break
        size -= 4
    at = ((left + right - x - x2) / 2, (top + bottom - y - y2) / 2)
    fill = rgb(ink)
    draw.multiline_text(
        at, word, fill, font, spacing=gap, align="center", stroke_width=bold, stroke_fill=fill
    )


def dot(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Iterable[float]) -> None:
    draw.ellipse([x - radius, y - radius, x + radius, y + radius], rgb(colour))


def speckle(canvas: Canvas, strength: float, grain: int = 2) -> None:
    """Apply fixed noise to the whole picture."""
    width, height = canvas.image.size
    noise = np.random.default_rng(7).normal(0, strength, (height // grain, width // grain, 1))
    noise = noise.repeat(grain, axis=0).repeat(grain, axis=1)
    pixels = np.asarray(canvas.image, dtype=np.float64)
    mixed = np.clip(pixels * (1 + noise[: pixels.shape[0], : pixels.shape[1]]), 0, 255)
    canvas.image.paste(Image.fromarray(mixed.astype(np.uint8)))
