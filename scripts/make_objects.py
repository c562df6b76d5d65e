#!/usr/bin/env python3
"""Write operators/objects: the meshes, stable poses and grasps of the objects in scripts/objects/builtin.yaml.

    scripts/make_objects.py [FOLDER]

Objects whose entry has not changed get the same mark, on which stored runs depend; raise BUILDER when the same entry
results in a different object. ``builtin.json`` has the marks, in the order of the entries.
"""

import argparse
import hashlib
import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from objects.schema import Basket, ObjectSpec, read_file
from objects.shapes import convex_parts, write_visual

from vlafuzz.common.arrays import Array
from vlafuzz.common.assets import operators_dir
from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.manipulation.rotations import rotation
from vlafuzz.worlds.tabletop.objects.catalogue import INDEX, write_model
from vlafuzz.worlds.tabletop.objects.model import Container, ObjectModel, StablePose
from vlafuzz.worlds.tabletop.objects.solids import UP, Solid, lying, normals, solid, stable_pose, write_parts

BUILDER = 6
ENTRIES = Path(__file__).parent / "objects" / "builtin.yaml"
FLAT = 2e-5  # distance up to which a corner counts as in a face's plane: corners are rounded to a micrometre
STEADY = 0.001  # least distance of the centre of mass from the face's edges, metres
NEAR = 0.8  # cosine of the largest angle between the requested pose and the stable one


def settled(body: Solid, up: Sequence[float]) -> Array | None:
    """The rotation ``(3, 3)`` onto the stable face for which ``up`` points most upwards; None without one."""
    wanted = np.array(up) / np.linalg.norm(up)
    faces = normals(body.hull)
    # Rounded, so that the last bit does not decide between mirrored faces
    steepness = np.round(faces @ wanted, 6)
    order = np.lexsort((*np.round(faces.T, 6), steepness))
    for face in faces[order][steepness[order] < -NEAR]:  # those that point down, the steepest first
        if lying(body, face, FLAT)[1] > STEADY:
            first = rotation(wanted, UP)
            return np.asarray(rotation(first @ face, -UP) @ first)
    return None


def build(name: str, spec: ObjectSpec, folder: Path) -> ObjectModel:
    """Build an object with its meshes in ``folder``; CatalogueError for poses unstable or without grasps."""
    drawn = convex_parts(spec.shape)
    points = np.concatenate(drawn)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    body = solid([part - centre for part in drawn])
    container = None
    if isinstance(spec.shape, Basket):
        width, depth, height = spec.shape.inner
        floor = float(spec.shape.wall - centre[2])
        container = Container(width, depth, round(floor, 6), round(floor + height, 6))
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
        stable_poses=tuple(stable_poses(name, spec, body)),
        supports=spec.supports,
        container=container,
        density=spec.mass / body.volume,
    )


def stable_poses(name: str, spec: ObjectSpec, body: Solid) -> Iterator[StablePose]:
    graspable = spec.role == "graspable"
    for key, chosen in spec.rests.items():
        where, turn = f"objects.{name}.rests.{key}", settled(body, chosen.up)
        if turn is None:
            raise CatalogueError(f"{where}: no stable face near this pose, got up {chosen.up!r}")
        pose = stable_pose(key, turn, body, rolls=chosen.rolls, graspable=graspable)
        if graspable and not pose.grasps:
            hint = "it opens 0.08 m: make the object thinner"
            raise CatalogueError(f"{where}: nothing that the gripper could grasp", hint)
        yield pose


def mark(name: str, spec: ObjectSpec) -> str:
    """20 hexadecimal digits of the entry and the builder's version."""
    text = json.dumps([BUILDER, name, spec.model_dump(mode="json")], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=operators_dir() / "objects")
    folder: Path = parser.parse_args().folder
    marks: dict[str, str] = {}
    for name, spec in read_file(ENTRIES).items():
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir(parents=True)
        write_model(build(name, spec, folder / name), folder / name)
        marks[name] = mark(name, spec)
        print(name)
    (folder / INDEX).write_text(json.dumps(marks, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
