"""Draws the objects' textures with Pillow; no other pictures are used. Boxes have a cell for each face."""

from collections.abc import Iterable

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from objects.schema import Box, Colour, Look, ObjectSpec
from vlafuzz.common.arrays import Array

WALL = (0.12, 0.87)  # v at the lower and upper end of a can's straight wall
CAP = 0.84  # v at which a bottle's cap begins
METRE = 0.2  # side of a woven surface that the texture covers, metres
STALK_UV = (0.01, 0.995)
LEAF_UV = (0.99, 0.995)
SILVER = (0.78, 0.79, 0.81)
SIDE = 512  # of a texture, and a box face's longer side, pixels
CELL = 1 / 3  # width of a face's cell, as a share of the texture
REPEATS = 3  # of a label around a can, so that it is always in view


class Canvas:
    """A picture being drawn on the object's base colour. Colours are sRGB in [0, 1], lengths pixels."""

    def __init__(self, size: tuple[int, int], colour: Colour, look: Look) -> None:
        self.image = Image.new("RGB", size, rgb(colour))
        self.draw, self.colour, self.look = ImageDraw.Draw(self.image), colour, look
        self.width, self.height = size

    def fill(self, left: float, top: float, right: float, bottom: float, rgb: tuple[int, int, int]) -> None:
        self.draw.rectangle([left, top, right, bottom], rgb)

    def dot(self, x: float, y: float, radius: float, colour: Iterable[float]) -> None:
        self.draw.ellipse([x - radius, y - radius, x + radius, y + radius], rgb(colour))

    def write(self, left: float, top: float, right: float, bottom: float) -> None:
        """Write the look's word, centred and as large as fits."""
        word, size = self.look.word, 200
        while True:
            font, bold, gap = ImageFont.load_default(size), max(1, size // 22), size // 8
            x, y, x2, y2 = self.draw.multiline_textbbox(
                (0, 0), word, font, spacing=gap, align="center", stroke_width=bold
            )
            if (x2 - x <= right - left and y2 - y <= bottom - top) or size <= 10:
                break
            size -= 4
        at, ink = ((left + right - x - x2) / 2, (top + bottom - y - y2) / 2), rgb(self.look.ink)
        self.draw.multiline_text(at, word, ink, font, spacing=gap, align="center", stroke_width=bold, stroke_fill=ink)

    def speckle(self, strength: float, grain: int = 2) -> None:
        """Apply fixed noise to the whole picture."""
        noise = np.random.default_rng(7).normal(0, strength, (self.height // grain, self.width // grain, 1))
        noise = noise.repeat(grain, axis=0).repeat(grain, axis=1)
        pixels = np.asarray(self.image, dtype=np.float64)
        mixed = np.clip(pixels * (1 + noise[: self.height, : self.width]), 0, 255)
        self.image.paste(Image.fromarray(mixed.astype(np.uint8)))


def rgb(colour: Iterable[float], shade: float = 1.0) -> tuple[int, int, int]:
    """SRGB in [0, 1], scaled by ``shade``, as bytes."""
    red, green, blue = (min(255, max(0, round(255 * part * shade))) for part in colour)
    return red, green, blue


def paint(spec: ObjectSpec) -> Image.Image:
    """The base colour texture of an object."""
    size = (768, 576) if spec.look.pattern == "label" else (SIDE, SIDE)
    canvas = Canvas(size, spec.colour, spec.look)
    if isinstance(spec.shape, Box):
        paint_box(canvas, spec.shape.size)
    elif spec.shape.kind == "bottle":
        paint_bottle(canvas)
    else:
        PAINTERS[spec.look.pattern](canvas)
    return canvas.image


def motif_none(canvas: Canvas) -> None:
    """The plain colour."""


def motif_wave(canvas: Canvas) -> None:
    _swell(canvas, 0.80, 0.08, rgb(canvas.look.accent))
    _swell(canvas, 0.92, 0.06, rgb((0.85, 0.1, 0.15)))


def motif_ribbon(canvas: Canvas) -> None:
    _swell(canvas, 0.76, 0.045, rgb(canvas.look.accent))
    _swell(canvas, 0.12, 0.03, rgb(canvas.look.accent))


def _swell(canvas: Canvas, middle: float, thick: float, colour: tuple[int, int, int]) -> None:
    x, half = np.arange(canvas.width), thick * canvas.height / 2
    for i, at in enumerate(canvas.height * (middle + 0.035 * np.sin(2 * np.pi * x / canvas.width))):
        canvas.draw.line([(i, at - half), (i, at + half)], colour)


def motif_disc(canvas: Canvas) -> None:
    radius = canvas.width * 0.24
    for reach, colour in ((1.12 * radius, (1.0, 1.0, 1.0)), (radius, canvas.look.accent)):
        canvas.dot(canvas.width / 2, canvas.height * 0.80, reach, colour)


def motif_bubbles(canvas: Canvas) -> None:
    for x, y, r in np.random.default_rng(3).random((26, 3)):
        canvas.dot(x * canvas.width, canvas.height * (0.68 + 0.3 * y), 4 + 10 * r, canvas.look.accent)
    canvas.fill(0, 0, canvas.width, canvas.height * 0.1, rgb(canvas.look.accent))


def motif_splash(canvas: Canvas) -> None:
    width, height = canvas.width, canvas.height
    turns = np.linspace(0, 2 * np.pi, 33)[:-1]
    reach = np.where(np.arange(32) % 2, 0.36, 0.48) * width
    middle = (width / 2, height * 0.42)
    star = np.stack([reach * np.cos(turns), 0.75 * reach * np.sin(turns)], axis=1) + middle
    canvas.draw.polygon([(float(x), float(y)) for x, y in star], rgb(canvas.look.accent))
    canvas.draw.ellipse([width * 0.3, height * 0.75, width * 0.5, height * 0.85], rgb((0.2, 0.6, 0.2)))


def motif_checks(canvas: Canvas) -> None:
    """Two slanted fields in the accent colour, half of the area."""
    width, height = canvas.width, canvas.height
    for x, y in ((0.0, 0.0), (0.5 * width, 0.5 * height)):
        right, low, slant = x + width / 2, y + height / 2, 0.08 * height
        canvas.draw.polygon([(x, y), (right, y - slant), (right, low - slant), (x, low)], rgb(canvas.look.accent))


_ALL_MOTIFS = (motif_none, motif_wave, motif_ribbon, motif_disc, motif_bubbles, motif_splash, motif_checks)
MOTIFS = {motif.__name__.removeprefix("motif_"): motif for motif in _ALL_MOTIFS}


def paint_plain(canvas: Canvas) -> None:
    """The base colour, slightly uneven."""
    canvas.speckle(0.04)


def paint_label(canvas: Canvas) -> None:
    """A can: metal ends, and the label three times around the wall."""
    width, height = canvas.width, canvas.height
    for row in range(height):
        v = 1 - row / height
        if not 0.09 < v < 0.9:
            shade = 0.72 if v > 0.955 or v < 0.05 else 1.0
            canvas.draw.line([(0, row), (width, row)], rgb(SILVER, shade))
    top, bottom = round((1 - WALL[1]) * height), round((1 - WALL[0]) * height)
    part, high = width // REPEATS, bottom - top
    label = Canvas((part, high), canvas.colour, canvas.look)
    MOTIFS[canvas.look.motif](label)
    label.write(part * 0.12, high * 0.22, part * 0.88, high * 0.62)
    for k in range(REPEATS):
        canvas.image.paste(label.image, (k * part, top))


def paint_bottle(canvas: Canvas) -> None:
    """A paper label around the body and a cap."""
    width, height = canvas.width, canvas.height
    canvas.speckle(0.02, 4)
    for v in np.arange(0.08, 0.24, 0.04):
        canvas.draw.line([(0, (1 - v) * height), (width, (1 - v) * height)], rgb(canvas.colour, 0.8), 5)
    canvas.fill(0, 0, width, (1 - CAP) * height, rgb(canvas.look.accent))
    top, bottom, part = 0.42 * height, 0.68 * height, width / REPEATS
    canvas.fill(0, top, width, bottom, rgb((1, 1, 1)))
    canvas.draw.line([(0, bottom - 8), (width, bottom - 8)], rgb(canvas.look.ink), 10)
    for k in range(REPEATS):
        canvas.write(part * (k + 0.12), top + 15, part * (k + 0.88), bottom - 25)


def paint_fruit(canvas: Canvas) -> None:
    """Pale streaks from the dimple down; the topmost rows have the colours of stalk and leaf."""
    width, height, look = canvas.width, canvas.height, canvas.look
    mix = rgb([0.75 * c + 0.25 * a for c, a in zip(canvas.colour, look.accent, strict=True)])
    for x, start, length in np.random.default_rng(5).random((90, 3)):
        top = height * (0.06 + 0.25 * start)
        canvas.draw.line([(x * width, top), (x * width, top + height * (0.1 + 0.35 * length))], mix, 2)
    canvas.fill(0, 0, width, height * 0.05, rgb(look.accent, 0.85))
    canvas.fill(0, 0, width // 2, 4, rgb((0.35, 0.22, 0.1)))
    canvas.fill(width // 2, 0, width, 4, rgb(look.ink))


def paint_peel(canvas: Canvas) -> None:
    """Small dimples, and a green navel at the top."""
    for x, y in np.random.default_rng(5).random((1800, 2)):
        canvas.dot(x * canvas.width, y * canvas.height, 2, [0.86 * part for part in canvas.colour])
    canvas.fill(0, 0, canvas.width, canvas.height * 0.05, rgb(canvas.look.accent))


def paint_rings(canvas: Canvas) -> None:
    """A carrot: dark rings across, and the green of its leaves at the bottom."""
    width, height = canvas.width, canvas.height
    for x, y, length in np.random.default_rng(5).random((70, 3)):
        left, row = x * width, y * height
        canvas.draw.line([(left, row), (left + (0.05 + 0.2 * length) * width, row)], rgb(canvas.colour, 0.72), 2)
    canvas.fill(0, height * 0.95, width, height, rgb(canvas.look.accent))


def paint_calyx(canvas: Canvas) -> None:
    """An eggplant: a green star of leaves around the thin end."""
    width, height = canvas.width, canvas.height
    points = [(k * width / 12, height * (0.72 if k % 2 else 0.87)) for k in range(13)]
    canvas.draw.polygon([(0, height), *points, (width, height)], rgb(canvas.look.accent))
    canvas.fill(0, height * 0.97, width, height, rgb(canvas.look.accent, 0.7))


def paint_weave(canvas: Canvas) -> None:
    step = SIDE // 16
    for i, j in np.ndindex(16, 16):
        flat, x, y = (i + j) % 2, i * step, j * step
        across, along = (0, 4) if flat else (4, 0)
        canvas.fill(x, y, x + step, y + step, rgb(canvas.look.accent, 0.55))
        fill = rgb(canvas.colour if flat else canvas.look.accent)
        canvas.fill(x + across, y + along, x + step - across, y + step - along, fill)


def paint_rim(canvas: Canvas) -> None:
    """A plate: two coloured lines, on the rim and around the middle."""
    for low, high in ((0.19, 0.30), (0.40, 0.43)):
        top, bottom = (1 - high) * canvas.height, (1 - low) * canvas.height
        canvas.fill(0, top, canvas.width, bottom, rgb(canvas.look.accent))


_ROUND = (paint_label, paint_plain, paint_fruit, paint_peel, paint_rings, paint_calyx, paint_weave, paint_rim)
PAINTERS = {painter.__name__.removeprefix("paint_"): painter for painter in _ROUND}


def cell(face: int, square: Array) -> Array:
    """UV of points ``(n, 2)`` in the unit square of a face: +x, -x, +y, -y, +z, -z, in rows of three."""
    margin = 0.004
    corner = np.array([face % 3 * CELL, 0.5 - face // 3 * 0.5])
    return np.asarray(corner + margin + square * (np.array([CELL, 0.5]) - 2 * margin))


def paint_box(canvas: Canvas, size: tuple[float, float, float]) -> None:
    """Paint the six faces of a box into their cells."""
    width, height = canvas.width, canvas.height
    for face in range(6):
        axis = face // 2
        wide = size[1] if axis != 1 else size[0]
        high = size[2] if axis < 2 else size[0]
        scale = SIDE / max(wide, high)
        part = Canvas((max(8, round(wide * scale)), max(8, round(high * scale))), canvas.colour, canvas.look)
        BOX_PAINTERS[canvas.look.pattern](part, face, 1 / scale)
        at = (round(face % 3 * width * CELL), face // 3 * height // 2)
        canvas.image.paste(part.image.resize((round(width * CELL) + 1, height // 2)), at)


def box_plain(canvas: Canvas, face: int, pixel: float) -> None:
    """Darker edges."""
    _framed(canvas, rgb(canvas.colour, 0.8), max(2, canvas.width // 24))


def _framed(canvas: Canvas, rgb: tuple[int, int, int], thick: int) -> None:
    canvas.draw.rectangle([0, 0, canvas.width - 1, canvas.height - 1], None, rgb, thick)


def box_pores(canvas: Canvas, face: int, pixel: float) -> None:
    """A sponge: pores, and a scouring pad at the bottom, visible as a stripe on the sides."""
    width, height = canvas.width, canvas.height
    for x, y, r in np.random.default_rng(11 + face).random((170, 3)):
        reach = (0.0006 + 0.0016 * r * r) / pixel
        canvas.dot(x * width, y * height, reach, [0.72 * part for part in canvas.colour])
    if face != 4:
        canvas.fill(0, 0 if face == 5 else 0.78 * height, width, height, rgb(canvas.look.accent))


def box_stripes(canvas: Canvas, face: int, pixel: float) -> None:
    accent = rgb(canvas.look.accent)
    for at in np.arange(0.012, 1.0, 0.03):
        canvas.fill(at / pixel, 0, (at + 0.009) / pixel, canvas.height, accent)
    if face >= 4:
        _framed(canvas, accent, round(0.004 / pixel))


def box_checks(canvas: Canvas, face: int, pixel: float) -> None:
    """Gingham: stripes in both directions, in the full colour where they cross."""
    mix = tuple((a + b) / 2 for a, b in zip(canvas.colour, canvas.look.accent, strict=True))
    step = 0.0225 / pixel
    for i, j in np.ndindex(int(canvas.width / step) + 1, int(canvas.height / step) + 1):
        fill = (canvas.colour, mix, canvas.look.accent)[i % 2 + j % 2]
        canvas.fill(i * step, j * step, (i + 1) * step, (j + 1) * step, rgb(fill))


_FLAT = (box_plain, box_pores, box_stripes, box_checks)
BOX_PAINTERS = {painter.__name__.removeprefix("box_"): painter for painter in _FLAT}
