"""The convex parts of every kind of shape, with few enough corners for PhysX (at most 255 per part).

Visual surfaces are in ``surfaces.py``. Lengths in metres; every shape has its own natural frame.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from vlafuzz.worlds.tabletop.objects.hulls import Array
from vlafuzz.worlds.tabletop.objects.schema import (
    Ball,
    Basket,
    Bottle,
    Box,
    Can,
    Carrot,
    Egg,
    Plate,
    Shape,
    Spoon,
)

SIDES = 24  # of a can, which deviates by 0.3 mm from a circle and has faces to lie on
SLIM = 12  # sides of thinner shapes
RIM_PIECES = 12
PROMINENT = 0.0008  # metres; PhysX drops corners that protrude by less than 0.7 mm (its planeTolerance)


def convex_parts(shape: Shape) -> list[Array]:
    """The convex bodies of a shape: arrays of points ``(n, 3)``."""
    match shape:
        case Can():
            return [revolve(can_profile(shape), SIDES)]
        case Bottle():
            return bottle(shape)
        case Ball():
            return [ball(shape)]
        case Box():
            return [box(shape.size)]
        case Carrot():
            return [along_x(revolve(carrot_profile(shape), SLIM))]
        case Egg():
            return [along_x(revolve(egg_profile(shape, (0.0, 0.5, 1.0), (1.0, 0.65, 0.3, 0.0)), SLIM))]
        case Spoon():
            return spoon(shape)
        case Plate():
            return plate(shape)
        case Basket():
            return basket(shape)


def revolve(profile: Sequence[tuple[float, float]], sides: int) -> Array:
    """Points of a prism with ``sides`` faces, one of them towards +x, through rings ``(radius, z)``.

    The number of corners is halved for rings that are too small.
    """
    rings = []
    for radius, z in profile:
        count = sides if radius > 0 else 1
        while count > 6 and radius * (1 - np.cos(2 * np.pi / count)) < PROMINENT:
            count //= 2
        angle = (np.arange(count) + 0.5) * 2 * np.pi / count
        rings.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)], axis=1))
    return np.concatenate(rings)


def along_x(points: Array) -> Array:
    """Rotate the axis from z to x, so that the face towards +x faces down."""
    return np.stack([points[:, 2], points[:, 1], -points[:, 0]], axis=1)


def box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    corner = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return np.asarray(corner * np.array(size) + np.array(centre))


def can_profile(can: Can) -> list[tuple[float, float]]:
    low, high = can.shoulder, can.height - can.shoulder
    return [(can.neck, 0.0), (can.radius, low), (can.radius, high), (can.neck, can.height)]


def bottle(shape: Bottle) -> list[Array]:
    waist = shape.height - shape.neck_height
    body = [(shape.radius, 0.0), (shape.radius, waist - shape.shoulder), (shape.neck, waist)]
    return [revolve(body, SIDES), revolve([(shape.neck, waist), (shape.neck, shape.height)], SLIM)]


def ball(shape: Ball) -> Array:
    """Rings with fewer sides towards the poles. The lowest is the base on which the ball rests."""
    rings = []
    for latitude, sides in ((-78, 6), (-52, 10), (-26, 14), (0, 16), (26, 14), (52, 10), (78, 6)):
        angle = np.radians(latitude)
        rings.append(revolve([(float(np.cos(angle)), float(np.sin(angle)))], sides))
    points = np.concatenate(rings)
    points[:, 2] /= np.sin(np.radians(78))
    return np.asarray(points * np.array([shape.diameter, shape.diameter, shape.height]) / 2)


def carrot_profile(carrot: Carrot) -> list[tuple[float, float]]:
    """The thick end is bevelled."""
    return [(carrot.radius * 0.7, 0.0), (carrot.radius, carrot.radius * 0.35), (carrot.tip, carrot.length)]


def egg_profile(egg: Egg, thin: ArrayLike, thick: ArrayLike) -> list[tuple[float, float]]:
    """Rings on the thin ball, then on the thick one, at shares of the angle from pole to common tangent."""
    lean = np.arcsin((egg.radius - egg.tip) / (egg.length - egg.radius - egg.tip))
    sharp, blunt = np.asarray(thin) * (np.pi / 2 - lean), np.asarray(thick) * (np.pi / 2 + lean)
    rings = [(egg.tip * float(np.sin(t)), egg.tip * float(1 - np.cos(t))) for t in sharp]
    far = [(egg.radius * float(np.sin(t)), egg.length - egg.radius * float(1 - np.cos(t))) for t in blunt]
    return rings + far


def spoon(shape: Spoon) -> list[Array]:
    """The bowl, then the two straight halves of the arched handle."""
    bowl = revolve([(0.55, 0.0), (0.85, 0.45), (1.0, 1.0)], SLIM) * [
        shape.bowl / 2,
        shape.width / 2,
        shape.depth,
    ] + [shape.bowl / 2, 0.0, 0.0]
    path = handle_path(shape)
    bars = (np.concatenate([_bar_end(a, shape), _bar_end(b, shape)]) for a, b in pairwise(path))
    return [bowl, *bars]


def handle_path(shape: Spoon) -> list[tuple[float, float]]:
    """``(x, z)`` of the handle's underside: at the bowl, at the top of the arch, at its end on the table."""
    return [
        (shape.bowl * 0.93, shape.depth - shape.thickness),
        (shape.bowl + 0.4 * (shape.length - shape.bowl), shape.height - shape.thickness),
        (shape.length, 0.0),
    ]


def _bar_end(at: tuple[float, float], shape: Spoon) -> Array:
    x, z = at
    half = shape.handle / 2
    return np.array([(x, y, h) for y in (-half, half) for h in (z, z + shape.thickness)])


def plate(shape: Plate) -> list[Array]:
    """The disc, then the pieces of the rim: wedges whose inner side slopes up to a narrow edge."""
    outer = shape.diameter / 2
    inner, edge = outer - shape.rim, outer - shape.rim / 4
    disc = revolve([(outer * 0.94, 0.0), (outer, shape.floor)], SIDES)
    pieces = []
    for k in range(RIM_PIECES):
        ends = [2 * np.pi * (k + j) / RIM_PIECES + np.pi / SIDES for j in (0, 1)]
        cut = [(inner, shape.floor), (outer, shape.floor), (edge, shape.height), (outer, shape.height)]
        pieces.append(np.array([(r * np.cos(a), r * np.sin(a), z) for a in ends for r, z in cut]))
    return [disc, *pieces]


def basket(shape: Basket) -> list[Array]:
    """The floor, then the walls at -x, +x, -y and +y."""
    width, depth, height = shape.inner
    wall = shape.wall
    middle = wall + height / 2
    parts = [box((width + 2 * wall, depth + 2 * wall, wall), (0, 0, wall / 2))]
    parts += [box((wall, depth + 2 * wall, height), (s * (width + wall) / 2, 0, middle)) for s in (-1, 1)]
    parts += [box((width, wall, height), (0, s * (depth + wall) / 2, middle)) for s in (-1, 1)]
    return parts
