"""Canvas, drawing functions for all painters, and the motifs of cans' labels: no artwork, plain shapes."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vlafuzz.worlds.tabletop.objects.schema import Colour, Look


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


def motif_none(canvas: Canvas) -> None:
    """The plain colour."""


def motif_wave(canvas: Canvas) -> None:
    _swell(canvas, 0.80, 0.08, rgb(canvas.look.accent))
    _swell(canvas, 0.92, 0.06, rgb((0.85, 0.1, 0.15)))


def motif_ribbon(canvas: Canvas) -> None:
    _swell(canvas, 0.76, 0.045, rgb(canvas.look.accent))
    _swell(canvas, 0.12, 0.03, rgb(canvas.look.accent))


def _swell(canvas: Canvas, middle: float, thick: float, colour: tuple[int, int, int]) -> None:
    width, height = canvas.image.size
    x = np.arange(width)
    y = height * (middle + 0.035 * np.sin(2 * np.pi * x / width))
    for i, at in enumerate(y):
        canvas.draw.line([(i, at - thick * height / 2), (i, at + thick * height / 2)], colour)


def motif_disc(canvas: Canvas) -> None:
    width, height = canvas.image.size
    radius = width * 0.24
    for reach, colour in ((1.12 * radius, (1.0, 1.0, 1.0)), (radius, canvas.look.accent)):
        dot(canvas.draw, width / 2, height * 0.80, reach, colour)


def motif_bubbles(canvas: Canvas) -> None:
    width, height = canvas.image.size
    random = np.random.default_rng(3)
    for x, y, r in random.random((26, 3)):
        dot(canvas.draw, x * width, height * (0.68 + 0.3 * y), 4 + 10 * r, canvas.look.accent)
    canvas.draw.rectangle([0, 0, width, height * 0.1], rgb(canvas.look.accent))


def motif_splash(canvas: Canvas) -> None:
    width, height = canvas.image.size
    middle = (width / 2, height * 0.42)
    turns = np.linspace(0, 2 * np.pi, 33)[:-1]
    reach = np.where(np.arange(32) % 2, 0.36, 0.48) * width
    points = np.stack([reach * np.cos(turns), 0.75 * reach * np.sin(turns)], axis=1) + middle
    star = [(float(x), float(y)) for x, y in points]
    canvas.draw.polygon(star, rgb(canvas.look.accent))
    canvas.draw.ellipse([width * 0.3, height * 0.75, width * 0.5, height * 0.85], rgb((0.2, 0.6, 0.2)))


def motif_checks(canvas: Canvas) -> None:
    """Two slanted fields in the accent colour, half of the area."""
    width, height = canvas.image.size
    for left, top in ((0.0, 0.0), (0.5, 0.5)):
        x, y = left * width, top * height
        right, low, slant = x + width / 2, y + height / 2, 0.08 * height
        field = [(x, y), (right, y - slant), (right, low - slant), (x, low)]
        canvas.draw.polygon(field, rgb(canvas.look.accent))


_ALL_MOTIFS = (motif_none, motif_wave, motif_ribbon, motif_disc, motif_bubbles, motif_splash, motif_checks)
MOTIFS = {motif.__name__.removeprefix("motif_"): motif for motif in _ALL_MOTIFS}
