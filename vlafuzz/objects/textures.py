"""Draws the objects' textures with Pillow; no other pictures are used."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw

from vlafuzz.objects.boxes import paint_box
from vlafuzz.objects.canvas import Canvas, dot, rgb, speckle, write
from vlafuzz.objects.labels import MOTIFS
from vlafuzz.objects.schema import Box, ObjectSpec

WALL = (0.12, 0.87)  # v at the lower and upper end of a can's straight wall
CAP = 0.84  # v at which a bottle's cap begins
METRE = 0.2  # side of a woven surface that the texture covers, metres
STALK_UV = (0.01, 0.995)
LEAF_UV = (0.99, 0.995)
SILVER = (0.78, 0.79, 0.81)
SIDE = 512
REPEATS = 3  # of a label around a can, so that it is always in view


def paint(spec: ObjectSpec) -> Image.Image:
    """The base colour texture of an object."""
    size = (768, 576) if spec.look.pattern == "label" else (SIDE, SIDE)
    image = Image.new("RGB", size, rgb(spec.colour))
    canvas = Canvas(image, ImageDraw.Draw(image), spec.colour, spec.look)
    if isinstance(spec.shape, Box):
        paint_box(canvas, spec.shape.size)
    elif spec.shape.kind == "bottle":
        paint_bottle(canvas)
    else:
        PAINTERS[spec.look.pattern](canvas)
    return image


def paint_plain(canvas: Canvas) -> None:
    """The base colour, slightly uneven."""
    speckle(canvas, 0.04)


def paint_label(canvas: Canvas) -> None:
    """A can: metal ends, and the label three times around the wall."""
    image, draw, colour, look = canvas
    width, height = image.size
    for row in range(height):
        v = 1 - row / height
        if not 0.09 < v < 0.9:
            draw.line([(0, row), (width, row)], rgb(SILVER, 0.72 if v > 0.955 or v < 0.05 else 1.0))
    top, bottom = round((1 - WALL[1]) * height), round((1 - WALL[0]) * height)
    part = width // REPEATS
    label = Image.new("RGB", (part, bottom - top), rgb(colour))
    MOTIFS[look.motif](Canvas(label, ImageDraw.Draw(label), colour, look))
    high = label.size[1]
    write(ImageDraw.Draw(label), look.word, (part * 0.12, high * 0.22, part * 0.88, high * 0.62), look.ink)
    for k in range(REPEATS):
        image.paste(label, (k * part, top))


def paint_bottle(canvas: Canvas) -> None:
    """A paper label around the body and a cap."""
    image, draw, colour, look = canvas
    width, height = image.size
    speckle(canvas, 0.02, 4)
    for v in np.arange(0.08, 0.24, 0.04):
        draw.line([(0, (1 - v) * height), (width, (1 - v) * height)], rgb(colour, 0.8), 5)
    draw.rectangle([0, 0, width, (1 - CAP) * height], rgb(look.accent))
    top, bottom = 0.42 * height, 0.68 * height
    draw.rectangle([0, top, width, bottom], rgb((1, 1, 1)))
    draw.line([(0, bottom - 8), (width, bottom - 8)], rgb(look.ink), 10)
    for k in range(REPEATS):
        part = width / REPEATS
        write(draw, look.word, (part * (k + 0.12), top + 15, part * (k + 0.88), bottom - 25), look.ink)


def paint_fruit(canvas: Canvas) -> None:
    """Pale streaks from the dimple down; the topmost rows have the colours of stalk and leaf."""
    image, draw, colour, look = canvas
    width, height = image.size
    random = np.random.default_rng(5)
    for x, start, length in random.random((90, 3)):
        top = height * (0.06 + 0.25 * start)
        mix = [0.75 * c + 0.25 * a for c, a in zip(colour, look.accent, strict=True)]
        draw.line([(x * width, top), (x * width, top + height * (0.1 + 0.35 * length))], rgb(mix), 2)
    draw.rectangle([0, 0, width, height * 0.05], rgb(look.accent, 0.85))
    draw.rectangle([0, 0, width // 2, 4], rgb((0.35, 0.22, 0.1)))
    draw.rectangle([width // 2, 0, width, 4], rgb(look.ink))


def paint_peel(canvas: Canvas) -> None:
    """Small dimples, and a green navel at the top."""
    image, draw, colour, look = canvas
    width, height = image.size
    for x, y in np.random.default_rng(5).random((1800, 2)):
        dot(draw, x * width, y * height, 2, [0.86 * part for part in colour])
    draw.rectangle([0, 0, width, height * 0.05], rgb(look.accent))


def paint_rings(canvas: Canvas) -> None:
    """A carrot: dark rings across, and the green of its leaves at the bottom."""
    image, draw, colour, look = canvas
    width, height = image.size
    for x, y, length in np.random.default_rng(5).random((70, 3)):
        row = y * height
        draw.line([(x * width, row), (x * width + (0.05 + 0.2 * length) * width, row)], rgb(colour, 0.72), 2)
    draw.rectangle([0, height * 0.95, width, height], rgb(look.accent))


def paint_calyx(canvas: Canvas) -> None:
    """An eggplant: a green star of leaves around the thin end."""
    image, draw, _, look = canvas
    width, height = image.size
    points = [(k * width / 12, height * (0.72 if k % 2 else 0.87)) for k in range(13)]
    draw.polygon([(0, height), *points, (width, height)], rgb(look.accent))
    draw.rectangle([0, height * 0.97, width, height], rgb(look.accent, 0.7))


def paint_weave(canvas: Canvas) -> None:
    """A plain weave."""
    _, draw, colour, look = canvas
    step = SIDE // 16
    for i in range(16):
        for j in range(16):
            flat = (i + j) % 2
            x, y = i * step, j * step
            draw.rectangle([x, y, x + step, y + step], rgb(look.accent, 0.55))
            inset = (0, 4) if flat else (4, 0)
            box = [x + inset[0], y + inset[1], x + step - inset[0], y + step - inset[1]]
            draw.rectangle(box, rgb(colour if flat else look.accent))


def paint_rim(canvas: Canvas) -> None:
    """A plate: two coloured lines, on the rim and around the middle."""
    image, draw, _, look = canvas
    width, height = image.size
    for low, high in ((0.19, 0.30), (0.40, 0.43)):
        draw.rectangle([0, (1 - high) * height, width, (1 - low) * height], rgb(look.accent))


PAINTERS: dict[str, Callable[[Canvas], None]] = {
    "label": paint_label,
    "plain": paint_plain,
    "fruit": paint_fruit,
    "peel": paint_peel,
    "rings": paint_rings,
    "calyx": paint_calyx,
    "weave": paint_weave,
    "rim": paint_rim,
}
