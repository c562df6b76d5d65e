"""The convex parts of every kind of shape, with few enough corners for PhysX (at most 255 per part).

Visual surfaces are in ``surfaces.py``. Lengths in metres; every shape has its own natural frame.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from vlafuzz.worlds.tabletop.objects import schema
from vlafuzz.worlds.tabletop.objects.hulls import Array

SIDES = 24  # of a can, which deviates by 0.3 mm from a circle and has faces to lie on
SLIM = 12  # sides of thinner shapes
RIM_PIECES = 12
PROMINENT = 0.0008  # metres; PhysX drops corners that protrude by less than 0.7 mm (its planeTolerance)


def convex_parts(shape: schema.Shape) -> list[Array]:
    """The convex bodies of a shape: arrays of points ``(n, 3)``."""
    match shape:
        case schema.Can():
            low, high = shape.shoulder, shape.height - shape.shoulder
            ends = (shape.neck, 0.0), (shape.neck, shape.height)
            return [revolve([ends[0], (shape.radius, low), (shape.radius, high), ends[1]], SIDES)]
        case schema.Bottle():
            waist = shape.height - shape.neck_height
            body = [(shape.radius, 0.0), (shape.radius, waist - shape.shoulder), (shape.neck, waist)]
            return [revolve(body, SIDES), revolve([(shape.neck, waist), (shape.neck, shape.height)], SLIM)]
        case schema.Ball():
            return [_ball(shape)]
        case schema.Box():
            return [_box(shape.size)]
        case schema.Carrot():  # the thick end is bevelled
            radius = shape.radius
            profile = [(radius * 0.7, 0.0), (radius, radius * 0.35), (shape.tip, shape.length)]
            return [along_x(revolve(profile, SLIM))]
        case schema.Egg():
            return [along_x(revolve(egg_profile(shape, (0.0, 0.5, 1.0), (1.0, 0.65, 0.3, 0.0)), SLIM))]
        case schema.Spoon():
            middle = [shape.bowl / 2, 0.0, 0.0]
            size = [shape.bowl / 2, shape.width / 2, shape.depth]
            return [revolve([(0.55, 0.0), (0.85, 0.45), (1.0, 1.0)], SLIM) * size + middle, *handle(shape)]
        case schema.Plate():
            return _plate(shape)
        case schema.Basket():
            return _basket(shape)


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


def _box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    corner = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return np.asarray(corner * np.array(size) + np.array(centre))


def _ball(shape: schema.Ball) -> Array:
    """Rings with fewer sides towards the poles. The lowest is the base on which the ball rests."""
    rings = []
    for latitude, sides in ((-78, 6), (-52, 10), (-26, 14), (0, 16), (26, 14), (52, 10), (78, 6)):
        angle = np.radians(latitude)
        rings.append(revolve([(float(np.cos(angle)), float(np.sin(angle)))], sides))
    points = np.concatenate(rings)
    points[:, 2] /= np.sin(np.radians(78))
    return np.asarray(points * np.array([shape.diameter, shape.diameter, shape.height]) / 2)


def egg_profile(egg: schema.Egg, thin: ArrayLike, thick: ArrayLike) -> list[tuple[float, float]]:
    """Rings on the thin ball, then on the thick one, at shares of the angle from pole to common tangent."""
    lean = np.arcsin((egg.radius - egg.tip) / (egg.length - egg.radius - egg.tip))
    sharp, blunt = np.asarray(thin) * (np.pi / 2 - lean), np.asarray(thick) * (np.pi / 2 + lean)
    rings = [(egg.tip * float(np.sin(t)), egg.tip * float(1 - np.cos(t))) for t in sharp]
    far = [(egg.radius * float(np.sin(t)), egg.length - egg.radius * float(1 - np.cos(t))) for t in blunt]
    return rings + far


def handle(shape: schema.Spoon) -> list[Array]:
    """The two straight halves of a spoon's handle: from the bowl to the top of the arch, and to the table."""
    path = [
        (shape.bowl * 0.93, shape.depth - shape.thickness),
        (shape.bowl + 0.4 * (shape.length - shape.bowl), shape.height - shape.thickness),
        (shape.length, 0.0),
    ]
    half = shape.handle / 2
    ends = [np.array([(x, y, h) for y in (-half, half) for h in (z, z + shape.thickness)]) for x, z in path]
    return [np.concatenate(bar) for bar in pairwise(ends)]


def _plate(shape: schema.Plate) -> list[Array]:
    """The disc, then the pieces of the rim: wedges whose inner side slopes up to a narrow edge."""
    outer = shape.diameter / 2
    inner, edge = outer - shape.rim, outer - shape.rim / 4
    cut = [(inner, shape.floor), (outer, shape.floor), (edge, shape.height), (outer, shape.height)]
    pieces = [revolve([(outer * 0.94, 0.0), (outer, shape.floor)], SIDES)]
    for k in range(RIM_PIECES):
        ends = [2 * np.pi * (k + j) / RIM_PIECES + np.pi / SIDES for j in (0, 1)]
        pieces.append(np.array([(r * np.cos(a), r * np.sin(a), z) for a in ends for r, z in cut]))
    return pieces


def _basket(shape: schema.Basket) -> list[Array]:
    """The floor, then the walls at -x, +x, -y and +y."""
    width, depth, height = shape.inner
    wall = shape.wall
    middle = wall + height / 2
    parts = [_box((width + 2 * wall, depth + 2 * wall, wall), (0, 0, wall / 2))]
    parts += [_box((wall, depth + 2 * wall, height), (s * (width + wall) / 2, 0, middle)) for s in (-1, 1)]
    parts += [_box((width, wall, height), (0, s * (depth + wall) / 2, middle)) for s in (-1, 1)]
    return parts
