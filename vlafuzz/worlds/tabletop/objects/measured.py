"""Builds an object of a pack from its meshes alone: convex parts, stable poses and grasps are measured.

As in the reference (``add_multiple_convex_collisions_from_file`` in SIMPLER's environments and ManiSkill's ``ycb.py``),
each connected part of the collision mesh becomes its convex hull.
"""

import colorsys
import io
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial import ConvexHull, QhullError
from trimesh.visual.material import PBRMaterial

from vlafuzz.common.arrays import Array
from vlafuzz.common.reading import MOST_PIXELS, decoded, read_bytes
from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.manipulation.rotations import quaternion
from vlafuzz.worlds.tabletop.objects import solids
from vlafuzz.worlds.tabletop.objects.hulls import corners, triangles
from vlafuzz.worlds.tabletop.objects.model import ROUGH, Container, Fit, ObjectModel, Role, StablePose
from vlafuzz.worlds.tabletop.objects.packs import MOST_BYTES, PackObject

FRICTION = 0.5  # as in the reference's environments
MOST_CORNERS = 64  # of a part; PhysX takes 255
PROMINENT = 0.0008  # metres; PhysX drops corners that protrude by less than 0.7 mm (its planeTolerance)
LEAST = 1e-9  # cubic metres; smaller parts are dropped
TALL, ROUND = 1.2, 1.15  # least height / width and most width / depth of an object that stands along y
SUPPORTS = {"plate", "cloth"}
CAVITIES = {  # measured on the meshes of ManiSkill's YCB
    "ycb:bowl": Container(0.072, 0.064, -0.0248, 0.0259),
    "ycb:plate": Container(0.12, 0.112, -0.0096, 0.0127),
}
HEAVIEST = 3.0  # a Panda's payload, kilograms; heavier objects are places
TRIED, KEPT = 8, 4  # the most stable poses that are examined, and that are kept
SEARCHED = 24  # the most that are examined if none of those has a grasp
ALIKE = 0.003  # two stable poses whose heights differ by less are one, metres
UPRIGHT = 0.7  # least cosine to the vertical
LONGEST = 2.0  # metres; a larger mesh is in other units
MOST_FACES, MOST_PARTS = 200_000, 500
COLOURS = {"red": 0.0, "orange": 0.08, "yellow": 0.15, "green": 0.36, "blue": 0.6, "purple": 0.78}  # hues


def build_measured(name: str, spec: PackObject, folder: Path) -> ObjectModel:
    """Build an object and write its meshes into ``folder``; the visual mesh only if the pack has none.

    A CatalogueError says why a mesh cannot be read, or has no stable pose.
    """
    meshes = _parts(spec)
    turn = _turn(np.concatenate(meshes), tall_y=spec.tall_y)
    points = [part @ turn.T * spec.scale for part in meshes]
    every = np.concatenate(points)
    centre = (every.min(axis=0) + every.max(axis=0)) / 2
    body = solids.solid([_reduced(part - centre) for part in points])
    supports = not SUPPORTS.isdisjoint(spec.spoken.split())
    cavity = CAVITIES.get(name)
    if spec.marks:  # a place for things, as large as the marker
        width, depth, height = np.ptp(body.hull, axis=0).round(4)
        cavity = Container(float(width), float(depth), float(height) / 2, float(height) / 2)
    mass = body.volume * spec.density
    is_place = supports or cavity is not None or mass > HEAVIEST
    poses = _stable_poses(name, body, graspable=not is_place)
    role: Role = "place" if is_place else "graspable" if poses[0].grasps else "obstacle"
    fit = Fit(spec.scale, quaternion(turn), -centre)
    visual, colour = _looks(spec, body, fit, folder)
    return ObjectModel(
        name=name,
        spoken=spec.spoken,
        role="marker" if spec.marks else role,
        mass=round(mass, 6),
        friction=FRICTION,
        colour=colour,
        parts=body.parts,
        vertices=body.hull,
        visual=visual,
        collision=solids.write_parts(body.parts, folder),
        stable_poses=poses[:1] if is_place else poses,
        supports=supports,
        container=cavity if poses[0].name == "upright" else None,
        density=spec.density,
        fit=fit,
    )


def _read(file: Path) -> bytes:
    return read_bytes(file, CatalogueError, most=MOST_BYTES, inside=file.parent)


@contextmanager
def _reading(file: Path) -> Iterator[io.BytesIO]:
    """Open a mesh; all kinds of errors that trimesh's readers raise for damaged ones become a CatalogueError."""
    data = _read(file)
    try:
        yield io.BytesIO(data)
    except Exception as error:
        raise CatalogueError(f"{file}: no mesh: {error}") from None


def _parts(spec: PackObject) -> list[Array]:
    """Corners ``(n, 3)`` of each connected part of the collision mesh, without tiny or flat parts."""
    with _reading(spec.collision) as data:
        kind = spec.collision.suffix[1:]
        loaded: Any = trimesh.load_mesh(data, file_type=kind, process=False, skip_materials=True)
        whole = trimesh.Trimesh(loaded.vertices, loaded.faces, process=False)
        _check_bounds(whole, spec.scale)
        whole.merge_vertices()
        pieces = [np.asarray(piece.vertices) for piece in whole.split(only_watertight=False)]
    if len(pieces) > MOST_PARTS:
        raise CatalogueError(f"{spec.collision}: {len(pieces)} separate parts, expected at most {MOST_PARTS}")
    kept = [piece for piece in pieces if _volume(piece) * spec.scale**3 > LEAST]
    if not kept:
        raise CatalogueError(f"{spec.collision}: nothing solid in it")
    return kept


def _check_bounds(mesh: trimesh.Trimesh, scale: float) -> None:
    """Raise a ValueError for a mesh of other than a moderate number of faces between points in space."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError("its vertices are not three finite numbers each")
    if not 0 < len(faces) <= MOST_FACES or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"it has {len(faces)} faces, expected 1 to {MOST_FACES} between its vertices")
    longest = float(np.ptp(vertices, axis=0).max()) * scale
    if longest > LONGEST:
        raise ValueError(f"it is {longest:.3g} m long, expected at most {LONGEST} m: is it in metres?")


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):  # too few points, or all in a plane
        return 0.0


def _turn(points: Array, *, tall_y: bool) -> Array:
    x, y, z = np.ptp(points, axis=0)
    stands_along_y = tall_y and y > TALL * max(x, z) and max(x, z) < ROUND * min(x, z)
    return np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if stands_along_y else np.eye(3)


def _reduced(points: Array) -> Array:
    """The prominent corners of a hull: PhysX drops the others, and limits their number."""
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


def _stable_poses(name: str, body: solids.Solid, *, graspable: bool) -> tuple[StablePose, ...]:
    """The stable poses, upright first, then by tilt; only those with a grasp if any of them has one."""
    turns = sorted(solids.stable_turns(body), key=lambda turn: (-(turn.up >= UPRIGHT), -turn.tilt))

    def posed(turn: solids.Stable) -> StablePose:
        return solids.stable_pose(_kind(turn), turn.turn, body, rolls=turn.rolls, graspable=graspable)

    poses = [posed(turn) for turn in _distinct(turns, body)]
    if not poses:
        raise CatalogueError(f"{name}: there is no pose in which it stays put")
    held = [pose for pose in poses if pose.grasps]
    if graspable and not held:  # about as wide as the gripper: it may fit on some faces
        held = [pose for pose in map(posed, turns[:SEARCHED]) if pose.grasps][:1]
    kept: list[StablePose] = []
    for pose in (held or poses)[:KEPT]:
        count = 1 + sum(other.name.partition("_")[0] == pose.name for other in kept)
        kept.append(pose if count == 1 else replace(pose, name=f"{pose.name}_{count}"))
    return tuple(kept)


def _distinct(turns: Sequence[solids.Stable], body: solids.Solid) -> list[solids.Stable]:
    """The turns that differ in height, at most one of them upright and one inverted."""
    kept: dict[tuple[float, float], solids.Stable] = {}
    for turn in turns:
        heights = body.hull @ turn.turn[2]
        low, high = float(heights.min()), float(heights.max())
        alike = any(abs(low - bottom) + abs(high - top) < ALIKE for bottom, top in kept)
        repeated = _kind(turn) != "lying" and _kind(turn) in map(_kind, kept.values())
        if not alike and not repeated and len(kept) < TRIED:
            kept[low, high] = turn
    return list(kept.values())


def _kind(turn: solids.Stable) -> str:
    return "upright" if turn.up >= UPRIGHT else "inverted" if turn.up <= -UPRIGHT else "lying"


def _looks(spec: PackObject, body: solids.Solid, fit: Fit, folder: Path) -> tuple[Path, Array]:
    """The visual mesh and its mean colour: of textures, else from the name."""
    files = sorted(spec.collision.parent.iterdir())
    pictures = [file for file in files if file.suffix.lower() in (".png", ".jpg", ".jpeg")]
    shown = [_mean(file) for file in pictures] or _embedded(spec.visual)
    hues = [COLOURS[word] for word in spec.spoken.split() if word in COLOURS]
    hue = hues[0] if hues else zlib.crc32(spec.spoken.encode()) % 360 / 360
    colour = np.round(np.mean(shown, axis=0) if shown else colorsys.hsv_to_rgb(hue, 0.45, 0.7), 4)
    return spec.visual or _write_plain(body, fit, colour, folder / "visual.glb"), colour


def _embedded(visual: Path | None) -> list[Array]:
    if visual is None or visual.suffix != ".glb":
        return []
    with _reading(visual) as data:
        meshes = trimesh.load_scene(data, file_type="glb").geometry.values()
        materials = [getattr(mesh.visual, "material", None) for mesh in meshes]
        textures = [getattr(material, "baseColorTexture", None) for material in materials]
        return [_mean_of(texture) for texture in textures if texture is not None]


def _mean(file: Path) -> Array:
    try:
        return _mean_of(decoded(_read(file), "PNG", "JPEG"))
    except ValueError as error:
        raise CatalogueError(f"{file}: {error}") from None


def _mean_of(picture: Image.Image) -> Array:
    """Mean sRGB in [0, 1] without black and white pixels, which fill the unused parts of a texture."""
    if picture.width * picture.height > MOST_PIXELS:
        raise ValueError(f"a texture of {picture.width} x {picture.height} pixels")
    flat = np.asarray(picture.convert("RGB").resize((64, 64))).reshape(-1, 3) / 255
    used = flat[(flat.max(axis=1) > 0.06) & (flat.min(axis=1) < 0.95)]
    return np.asarray((used if len(used) else flat).mean(axis=0), dtype=np.float64)


def _write_plain(body: solids.Solid, fit: Fit, colour: Array, file: Path) -> Path:
    """Write the solid as the visual mesh, in one colour and in the frame of the pack's mesh."""
    corners_of_faces = [part[triangles(part)].reshape(-1, 3) for part in body.parts]  # edges stay sharp
    vertices = (np.concatenate(corners_of_faces) - fit.position) @ fit.turn / fit.scale
    mesh = trimesh.Trimesh(vertices, np.arange(len(vertices)).reshape(-1, 3), process=False)
    material = PBRMaterial(baseColorFactor=[*colour, 1.0], metallicFactor=0.0, roughnessFactor=ROUGH)
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    mesh.export(file, include_normals=True)
    return file
