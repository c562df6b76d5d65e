"""Builds one object of a pack from its meshes: solid, rest poses and grasps are measured, none believed.

Its solid is what the reference makes of it (``add_multiple_convex_collisions_from_file``, in SIMPLER's
environments and in ManiSkill's ``ycb.py``): each connected part of the collision mesh as its convex hull.
"""

from __future__ import annotations

import colorsys
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial import ConvexHull, QhullError

from vlafuzz.errors import CatalogueError
from vlafuzz.objects.build import rest_pose, write_part
from vlafuzz.objects.cavities import room_inside
from vlafuzz.objects.hulls import Array, corners, triangles
from vlafuzz.objects.model import Container, Fit, ObjectModel, RestPose, Role
from vlafuzz.objects.packs import PackObject
from vlafuzz.objects.shapes import PROMINENT
from vlafuzz.objects.stable_poses import Solid, Stable, quaternion, solid, stable_turns

FRICTION = 0.5  # as the reference's environments have it
MOST_CORNERS = 64  # of a part; PhysX takes 255
LEAST = 1e-9  # cubic metres, below which a part is a speck
TALL, ROUND = 1.2, 1.15  # how much taller than wide, and wider than deep, what stands along y is
SUPPORTS = {"plate", "cloth"}
HEAVIEST = 3.0  # kilograms that a Panda carries; what is heavier is furniture
TRIED, RESTS = 8, 4  # the most rest poses that are looked at, and that are kept
SEARCHED = 24  # likewise, where none of them can be held
ALIKE = 0.003  # metres of height within which two rest poses are one
UPRIGHT = 0.7  # cosine to the vertical
COLOURS = {"red": 0.0, "orange": 0.08, "yellow": 0.15, "green": 0.36, "blue": 0.6, "purple": 0.78}  # hues


def build_measured(name: str, spec: PackObject, folder: Path) -> ObjectModel:
    """Build an object and write its solid into ``folder``, and plain looks where the pack has none.

    Raises:
        CatalogueError: the mesh is none, or has no pose in which it stays put.
    """
    meshes = _parts(spec)
    turn = _turn(np.concatenate(meshes), tall_y=spec.tall_y)
    points = [part @ turn.T * spec.scale for part in meshes]
    every = np.concatenate(points)
    centre = (every.min(axis=0) + every.max(axis=0)) / 2
    body = solid([_lean(part - centre) for part in points])
    supports = not SUPPORTS.isdisjoint(spec.spoken.split())
    mass, room = body.volume * spec.density, _room(spec, body)
    stays = supports or room is not None or mass > HEAVIEST
    rests = _rests(name, body, can_be_held=not stays)
    colour = _colour(spec)
    fit = Fit(spec.scale, quaternion(turn), -centre)
    visual = spec.visual or _write_plain(body, fit, colour, folder / "visual.glb")
    return ObjectModel(
        name=name,
        spoken=spec.spoken,
        role=_role(spec, rests, stays=stays),
        mass=round(mass, 6),
        friction=FRICTION,
        colour=colour,
        parts=body.parts,
        vertices=body.hull,
        visual=visual,
        collision=tuple(write_part(part, folder / f"part_{i:02d}.obj") for i, part in enumerate(body.parts)),
        rests=rests[:1] if stays else rests,
        supports=supports,
        container=room if rests[0].name == "upright" else None,
        density=spec.density,
        fit=fit,
        box=turn @ spec.sides if spec.sides else None,
    )


def _role(spec: PackObject, rests: Sequence[RestPose], *, stays: bool) -> Role:
    if spec.marks:
        return "marker"
    return "place" if stays else "graspable" if rests[0].grasps else "obstacle"


def _room(spec: PackObject, body: Solid) -> Container | None:
    """The room inside; that of a marker is its rectangle."""
    if not spec.marks:
        return room_inside(body.parts)
    width, depth, height = np.ptp(body.hull, axis=0).round(4)
    return Container(float(width), float(depth), float(height) / 2, float(height) / 2)


def _parts(spec: PackObject) -> list[Array]:
    """Corners ``(n, 3)`` of each connected part of the collision mesh, without specks and slivers."""
    try:
        loaded = trimesh.load_mesh(spec.collision, process=False)
        whole = trimesh.Trimesh(loaded.vertices, loaded.faces, process=False)
        whole.merge_vertices()
        pieces = [np.asarray(piece.vertices) for piece in whole.split(only_watertight=False)]
    except Exception as error:  # whatever a reader of meshes throws at a damaged file
        raise CatalogueError(f"{spec.collision}: no mesh: {' '.join(str(error).split())}") from None
    kept = [piece for piece in pieces if _volume(piece) * spec.scale**3 > LEAST]
    if not kept:
        raise CatalogueError(f"{spec.collision}: nothing solid in it")
    return kept


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):  # too few points, or all in a plane
        return 0.0


def _turn(points: Array, *, tall_y: bool) -> Array:
    """The rotation ``(3, 3)`` after which z is up."""
    x, y, z = np.ptp(points, axis=0)
    stands_along_y = tall_y and y > TALL * max(x, z) and max(x, z) < ROUND * min(x, z)
    return np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if stands_along_y else np.eye(3)


def _lean(points: Array) -> Array:
    """The corners of a hull that stand out: what PhysX would drop or has no room for is left out."""
    every = corners(points)
    if len(every) <= MOST_CORNERS:
        return every
    outwards = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    chosen = sorted(set(np.argmax(every @ outwards.T, axis=0).tolist()))
    while len(chosen) < MOST_CORNERS:
        planes = ConvexHull(every[chosen]).equations
        beyond = (every @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        farthest = int(beyond.argmax())
        if beyond[farthest] < PROMINENT:
            break
        chosen.append(farthest)
    return np.asarray(every[chosen])


def _rests(name: str, body: Solid, *, can_be_held: bool) -> tuple[RestPose, ...]:
    """The rest poses, upright first, then the steadiest; of what can be held only those in which it can."""
    stable = sorted(stable_turns(body), key=lambda each: (-(each.up >= UPRIGHT), -each.lean))
    found = [_rest(each, body, held=can_be_held) for each in _unlike(stable, body)]
    if not found:
        raise CatalogueError(f"{name}: there is no pose in which it stays put")
    held = [rest for rest in found if rest.grasps]
    if can_be_held and not held:  # as wide as the gripper: it may fit on some faces
        rests = (_rest(each, body, held=True) for each in stable[:SEARCHED])
        held = [rest for rest in rests if rest.grasps][:1]
    kept = (held or found)[:RESTS]
    kinds = [rest.name for rest in kept]
    counts = [kinds[: number + 1].count(kind) for number, kind in enumerate(kinds)]
    return tuple(
        replace(rest, name=rest.name if count == 1 else f"{rest.name}_{count}")
        for rest, count in zip(kept, counts, strict=True)
    )


def _rest(stable: Stable, body: Solid, *, held: bool) -> RestPose:
    return rest_pose(_kind(stable.up), stable.turn, body, rolls=stable.rolls, held=held)


def _unlike(stable: Sequence[Stable], body: Solid) -> list[Stable]:
    """Of some ways to stay put those that differ in height, at most one of them upright and one inverted."""
    kept: dict[tuple[float, float], Stable] = {}
    for each in stable:
        heights = body.hull @ each.turn[2]
        low, high = float(heights.min()), float(heights.max())
        known = any(abs(low - one) + abs(high - other) < ALIKE for one, other in kept)
        again = _kind(each.up) != "lying" and any(_kind(k.up) == _kind(each.up) for k in kept.values())
        if not known and not again and len(kept) < TRIED:
            kept[low, high] = each
    return list(kept.values())


def _kind(up: float) -> str:
    return "upright" if up >= UPRIGHT else "inverted" if up <= -UPRIGHT else "lying"


def _colour(spec: PackObject) -> Array:
    """The colour of its textures; without any the one that its name says, or one of its own."""
    pictures = [
        file
        for file in sorted(spec.collision.parent.iterdir())
        if file.suffix.lower() in (".png", ".jpg", ".jpeg")
    ]
    shown = _embedded(spec.visual) if spec.visual and not pictures else [_mean(file) for file in pictures]
    if shown:
        return np.asarray(np.round(np.mean(shown, axis=0), 4), dtype=np.float64)
    hue = next(
        (COLOURS[word] for word in spec.spoken.split() if word in COLOURS),
        zlib.crc32(spec.spoken.encode()) % 360 / 360,
    )
    return np.round(colorsys.hsv_to_rgb(hue, 0.45, 0.7), 4)


def _embedded(visual: Path) -> list[Array]:
    """The mean colours of the textures in a GLB."""
    if visual.suffix != ".glb":
        return []
    found = []
    for mesh in trimesh.load_scene(visual).geometry.values():
        picture = getattr(getattr(mesh.visual, "material", None), "baseColorTexture", None)
        if picture is not None:
            found.append(_mean_of(picture))
    return found


def _mean(file: Path) -> Array:
    with Image.open(file) as picture:
        return _mean_of(picture)


def _mean_of(picture: Image.Image) -> Array:
    """Its sRGB in 0..1, without black and white: these are where the object uses nothing of it."""
    flat = np.asarray(picture.convert("RGB").resize((64, 64))).reshape(-1, 3) / 255
    used = flat[(flat.max(axis=1) > 0.06) & (flat.min(axis=1) < 0.95)]
    return np.asarray((used if len(used) else flat).mean(axis=0), dtype=np.float64)


def _write_plain(body: Solid, fit: Fit, colour: Array, file: Path) -> Path:
    """The solid itself as looks, in one colour and in the frame of its mesh."""
    corners_of_faces = [part[triangles(part)].reshape(-1, 3) for part in body.parts]  # edges stay sharp
    vertices = (np.concatenate(corners_of_faces) - fit.position) @ fit.turn / fit.scale
    mesh = trimesh.Trimesh(vertices, np.arange(len(vertices)).reshape(-1, 3), process=False)
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*colour, 1.0], metallicFactor=0.0, roughnessFactor=0.7
    )
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    mesh.export(file, include_normals=True)
    return file
