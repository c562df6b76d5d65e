"""Motifs of cans' labels: plain shapes and colours, no artwork."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vlafuzz.objects.canvas import Canvas, dot, rgb


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


MOTIFS: dict[str, Callable[[Canvas], None]] = {
    "none": motif_none,
    "wave": motif_wave,
    "ribbon": motif_ribbon,
    "disc": motif_disc,
    "bubbles": motif_bubbles,
    "splash": motif_splash,
    "checks": motif_checks,
}
