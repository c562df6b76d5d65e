"""Builds an object from its catalogue entry: convex parts, stable poses, grasps and mesh files."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.tabletop.objects.grasps import find_grasps
from vlafuzz.worlds.tabletop.objects.hulls import Array, outline, triangles
from vlafuzz.worlds.tabletop.objects.model import Container, Grasp, ObjectModel, StablePose
from vlafuzz.worlds.tabletop.objects.schema import Basket, ObjectSpec
from vlafuzz.worlds.tabletop.objects.shapes import convex_parts
from vlafuzz.worlds.tabletop.objects.stable_poses import Solid, quaternion, settled, solid
from vlafuzz.worlds.tabletop.objects.surfaces import write_visual


def build(name: str, spec: ObjectSpec, folder: Path) -> ObjectModel:
    """Build an object and write its meshes into ``folder``.

    Raises:
        CatalogueError: a pose is not stable, or leaves nothing for the gripper to grasp.
    """
    drawn = convex_parts(spec.shape)
    points = np.concatenate(drawn)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    body = solid([part - centre for part in drawn])
    visual = folder / "visual.glb"
    write_visual(spec, centre, visual)
    return ObjectModel(
        name=name,
        spoken=spec.spoken or name.replace("_", " "),
        role=spec.role,
        mass=spec.mass,
        friction=spec.friction,
        colour=np.array(spec.colour),
        parts=body.parts,
        vertices=body.hull,
        visual=visual,
        collision=write_parts(body.parts, folder),
        stable_poses=tuple(_stable_poses(name, spec, body)),
        supports=spec.supports,
        container=_container(spec.shape, centre) if isinstance(spec.shape, Basket) else None,
        density=spec.mass / body.volume,
    )


def _stable_poses(name: str, spec: ObjectSpec, body: Solid) -> Iterator[StablePose]:
    graspable = spec.role == "graspable"
    for key, chosen in spec.rests.items():
        where = f"objects.{name}.rests.{key}"
        try:
            pose = stable_pose(key, settled(body, chosen.up), body, rolls=chosen.rolls, graspable=graspable)
        except CatalogueError as error:
            raise CatalogueError(f"{where}: {error}", error.hint) from None
        if graspable and not pose.grasps:
            hint = "it opens 0.08 m: make the object thinner"
            raise CatalogueError(f"{where}: nothing that the gripper could grasp", hint)
        yield pose


def stable_pose(name: str, turn: Array, body: Solid, *, rolls: bool, graspable: bool) -> StablePose:
    """The stable pose of a solid after a rotation ``(3, 3)``, with grasps if it is ``graspable``."""
    height = float(np.round(-(body.hull @ turn.T)[:, 2].min(), 6))
    lift = np.array([0.0, 0.0, height])
    hull = np.round(body.hull @ turn.T + lift, 6) + 0.0
    grasps: tuple[Grasp, ...] = ()
    if graspable:
        grasps = find_grasps([part @ turn.T + lift for part in body.parts], turn @ body.balance + lift)
    return StablePose(
        name=name,
        quaternion=quaternion(turn),
        height=height,
        top=float(hull[:, 2].max()),
        footprint=outline(hull[:, :2]),
        rolls=rolls,
        grasps=grasps,
    )


def _container(shape: Basket, centre: Array) -> Container:
    width, depth, height = shape.inner
    floor = float(shape.wall - centre[2])
    return Container(width, depth, round(floor, 6), round(floor + height, 6))


def write_parts(parts: Sequence[Array], folder: Path) -> tuple[Path, ...]:
    """Write each convex part as OBJ."""
    files = tuple(folder / f"part_{number:02d}.obj" for number in range(len(parts)))
    for file, points in zip(files, parts, strict=True):
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles(points)]
        file.write_text("\n".join(lines) + "\n")
    return files
