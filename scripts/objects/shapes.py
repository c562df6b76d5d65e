"""The shapes: their convex parts for PhysX, and their smooth visual meshes with a UV map, written as GLB.

A convex part has at most 255 corners. All surfaces of revolution share one unwrapping: u runs once around, with +x in
the middle; v is specified per ring, so that labels do not depend on the dimensions of lids. v = 0 is the bottom row.
Lengths in metres; every shape has its own natural frame.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from objects import schema, textures
from vlafuzz.common.arrays import Array
from vlafuzz.worlds.tabletop.objects.hulls import Faces, triangles
from vlafuzz.worlds.tabletop.objects.measured import PROMINENT

SIDES = 24  # of a can, which deviates by 0.3 mm from a circle and has faces to lie on
SLIM = 12  # sides of thinner shapes
RIM_PIECES = 12


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


ROUND = 48  # sides of a surface of revolution
CREASE = np.cos(np.radians(40))
SMALL = 1e-9
Ring = tuple[float, float, float]


class Surface(NamedTuple):
    """A mesh: ``(n, 3)`` vertices in metres, ``(n, 3)`` normals, ``(n, 2)`` UV, ``(m, 3)`` faces."""

    vertices: Array
    normals: Array
    uv: Array
    faces: Faces


def write_visual(spec: schema.ObjectSpec, centre: Array, file: Path) -> None:
    """Write the object's GLB, moved by ``-centre``."""
    material = PBRMaterial(
        baseColorTexture=textures.paint(spec), metallicFactor=0.0, roughnessFactor=spec.look.roughness
    )
    whole = join(surfaces(spec.shape))
    mesh = trimesh.Trimesh(
        whole.vertices - centre,
        whole.faces,
        vertex_normals=whole.normals,
        visual=TextureVisuals(whole.uv, material=material),
        process=False,
    )
    mesh.export(file, include_normals=True)


def join(pieces: Sequence[Surface]) -> Surface:
    vertices, normals, uv, faces = zip(*pieces, strict=True)
    starts = np.cumsum([0, *map(len, vertices[:-1])])
    shifted = [part + start for part, start in zip(faces, starts, strict=True)]
    return Surface(*map(np.concatenate, (vertices, normals, uv, shifted)))


def surfaces(shape: schema.Shape) -> list[Surface]:
    match shape:
        case schema.Can():
            return [turned(can_rings(shape))]
        case schema.Bottle():
            return [turned(bottle_rings(shape))]
        case schema.Ball():
            return [turned(ball_rings(shape)), *stalk(shape)]
        case schema.Carrot():
            return [laid(turned(carrot_rings(shape)))]
        case schema.Egg():
            profile = egg_profile(shape, np.linspace(0, 1, 9), np.linspace(1, 0, 12))
            return [laid(turned([(radius, z, z / shape.length) for radius, z in profile]))]
        case schema.Plate():
            return [turned(plate_rings(shape))]
        case schema.Spoon():
            return spoon_surfaces(shape)
        case schema.Box():
            return [box_surface(convex_parts(shape)[0], shape.size)]
        case schema.Basket():
            return [box_surface(part, None) for part in convex_parts(shape)]


def turned(rings: Sequence[Ring], stretch: Array | None = None) -> Surface:
    """The surface of revolution about z through rings ``(radius, z, v)``, starting at the bottom.

    Edges of more than 40° stay sharp. ``stretch`` scales x, y and z afterwards.
    """
    line = np.array(rings)
    step = np.diff(line[:, :2], axis=0)
    slopes = np.stack([step[:, 1], -step[:, 0]], axis=1)
    slopes /= np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), SMALL)
    pieces = []
    for i, slope in enumerate(slopes):
        before, after = slopes[max(i - 1, 0)], slopes[min(i + 1, len(slopes) - 1)]
        ends = [slope + other if slope @ other > CREASE else slope for other in (before, after)]
        pieces.append(_band(line[i : i + 2], np.array(ends)))
    whole = join(pieces)
    scale = np.ones(3) if stretch is None else stretch
    return whole._replace(vertices=whole.vertices * scale, normals=_unit(whole.normals / scale))


def _unit(normals: Array) -> Array:
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), SMALL))


def _band(ends: Array, slopes: Array) -> Surface:
    """The strip between two rings. ``slopes``: ``(2, 2)``, radial and axial part of their normals."""
    turn = np.linspace(0, 1, ROUND + 1)
    angle, column = 2 * np.pi * (turn - 0.5), np.ones((ROUND + 1, 1))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.hstack([circle * radius, column * z]) for radius, z, _ in ends])
    normals = np.concatenate([np.hstack([circle * out, column * up]) for out, up in slopes])
    uv = np.concatenate([np.stack([turn, np.full(len(turn), v)], axis=1) for *_, v in ends])
    n, i = len(turn), np.arange(ROUND)
    faces = np.concatenate([np.stack([i, i + 1, i + n + 1], axis=1), np.stack([i, i + n + 1, i + n], axis=1)])
    return Surface(vertices, _unit(normals), uv, faces)


def laid(surface: Surface) -> Surface:
    """Rotate the axis from z to x, as ``shapes.along_x``."""
    return surface._replace(vertices=along_x(surface.vertices), normals=along_x(surface.normals))


def can_rings(can: schema.Can) -> list[Ring]:
    top, neck = can.height, can.neck
    return [
        (0.0, 0.006, 0.0),
        (neck - 0.005, 0.004, 0.04),
        (neck - 0.003, 0.0, 0.06),
        (neck, 0.002, 0.08),
        (can.radius, can.shoulder, textures.WALL[0]),
        (can.radius, top - can.shoulder, textures.WALL[1]),
        (neck, top - 0.002, 0.92),
        (neck - 0.001, top, 0.93),
        (neck - 0.003, top, 0.94),
        (neck - 0.004, top - 0.004, 0.95),
        (0.0, top - 0.004, 1.0),
    ]


def bottle_rings(shape: schema.Bottle) -> list[Ring]:
    top, waist, foot = shape.height, shape.height - shape.neck_height, 0.004
    low, wider = waist - shape.shoulder, shape.radius - shape.neck
    shoulder = [
        (shape.neck + wider * (np.cos(t * np.pi) / 2 + 0.5), low + shape.shoulder * t, 0.65 + 0.13 * t)
        for t in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
    ]
    cap = waist + 0.35 * shape.neck_height
    return [
        (0.0, 0.002, 0.0),
        (shape.radius - foot, 0.0, 0.02),
        (shape.radius, foot, 0.04),
        *shoulder,
        (shape.neck * 0.93, waist + 0.002, 0.79),
        (shape.neck * 0.93, cap, textures.CAP),
        (shape.neck, cap, textures.CAP + 0.01),
        (shape.neck, top - 0.001, 0.95),
        (shape.neck - 0.001, top, 0.96),
        (0.0, top, 1.0),
    ]


def ball_rings(shape: schema.Ball) -> list[Ring]:
    rings = []
    for t in np.linspace(0, 1, 25):
        radius, z = np.sin(np.pi * t), -np.cos(np.pi * t)
        sink = 2 * shape.dimple / shape.height * np.exp(-((radius / 0.22) ** 2)) * (1.0 if z > 0 else 0.4)
        rings.append((radius * shape.diameter / 2, (z - np.sign(z) * sink) * shape.height / 2, float(t)))
    return rings


def stalk(shape: schema.Ball) -> list[Surface]:
    if not shape.dimple:
        return []
    foot = shape.height / 2 - shape.dimple
    thin = turned([(0.0012, foot - 0.002, 0.99), (0.0016, foot + 0.012, 0.99), (0.0, foot + 0.0121, 0.99)])
    along = np.linspace(0, 1, 9)
    side = 0.008 * np.sin(np.pi * along)
    spine = np.stack([0.001 + 0.026 * along, 0.002 + 0.010 * along, foot + 0.007 + 0.006 * np.sin(2.6 * along)], axis=1)
    across = np.array([-0.36, 0.93, 0.0])
    vertices = np.concatenate([spine + side[:, None] * across, spine - side[:, None] * across])
    i = np.arange(8)
    faces = np.concatenate([np.stack([i, i + 9, i + 10], axis=1), np.stack([i, i + 10, i + 1], axis=1)])
    up = np.tile([0.0, 0.0, 1.0], (18, 1))
    uv = np.tile(textures.LEAF_UV, (18, 1))
    leaf = [Surface(vertices, up, uv, faces), Surface(vertices, -up, uv, faces[:, ::-1])]
    return [thin._replace(uv=np.tile(textures.STALK_UV, (len(thin.uv), 1))), *leaf]


def carrot_rings(carrot: schema.Carrot) -> list[Ring]:
    """The leaves' stub, which is visual only, then the root."""
    bulge = [(t, np.sqrt(1 - (1 - t) ** 2)) for t in (0.0, 0.05, 0.15, 0.4, 0.7, 1.0)]
    radius, end = carrot.radius, carrot.tip
    leaves = [(0.0, -0.010, 0.0), (0.40 * radius, -0.014, 0.02), (0.22 * radius, 0.0, 0.04)]
    thick = [(radius * r, 0.35 * radius * t, 0.06 + 0.06 * t) for t, r in bulge[1:]]
    thin = [(end * r, carrot.length - end * t, 1 - 0.1 * t) for t, r in reversed(bulge)]
    return leaves + thick + thin


def plate_rings(shape: schema.Plate) -> list[Ring]:
    outer = shape.diameter / 2
    inner, edge = outer - shape.rim, outer - shape.rim / 4
    return [
        (0.0, 0.0, 0.0),
        (outer * 0.94, 0.0, 0.1),
        (outer, shape.floor, 0.15),
        (outer, shape.height - 0.001, 0.2),
        ((outer + edge) / 2, shape.height, 0.23),
        (edge, shape.height - 0.001, 0.26),
        (inner, shape.floor, 0.4),
        (0.0, shape.floor, 1.0),
    ]


def spoon_surfaces(shape: schema.Spoon) -> list[Surface]:
    """A hollow bowl, and the bars of the handle."""
    outer = [(0.0, 0.0, 0.0), (0.55, 0.0, 0.1), (0.75, 0.22, 0.2), (0.9, 0.6, 0.3), (1.0, 1.0, 0.4)]
    inner = [(0.94, 1.0, 0.5), (0.8, 0.55, 0.6), (0.55, 0.25, 0.8), (0.0, 0.15, 1.0)]
    bowl = turned(outer + inner, np.array([shape.bowl / 2, shape.width / 2, shape.depth]))
    moved = bowl._replace(vertices=bowl.vertices + np.array([shape.bowl / 2, 0.0, 0.0]))
    return [moved, *map(faceted, handle(shape))]


def faceted(points: Array) -> Surface:
    """The hull of points ``(n, 3)`` with sharp edges, in one colour."""
    corner = points[triangles(points)]
    normals = _unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    vertices = corner.reshape(-1, 3)
    uv, faces = np.full((len(vertices), 2), 0.5), np.arange(len(vertices)).reshape(-1, 3)
    return Surface(vertices, np.repeat(normals, 3, axis=0), uv, faces)


def box_surface(points: Array, size: Sequence[float] | None) -> Surface:
    """A box with the texture cells of ``textures.cell``, or without ``size`` with a uniform pattern."""
    low, high = points.min(axis=0), points.max(axis=0)
    pieces = []
    for face, (axis, side) in enumerate((a, s) for a in range(3) for s in (1, -1)):
        normal = np.eye(3)[axis] * side
        right = np.cross([0.0, 0.0, 1.0], normal) if axis < 2 else np.array([0.0, side, 0.0])
        top = np.cross(normal, right)
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)
        middle, half = (low + high) / 2, (high - low) / 2
        across, up = ((2 * square[:, [i]] - 1) * way * half for i, way in enumerate((right, top)))
        vertices = middle + normal * half + (across + up)
        spread = np.array([abs(right) @ (high - low), abs(top) @ (high - low)]) / textures.METRE
        uv = textures.cell(face, square) if size is not None else square * spread
        pieces.append(Surface(vertices, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]])))
    return join(pieces)
