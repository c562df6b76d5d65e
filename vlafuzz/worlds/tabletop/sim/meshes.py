"""Simplified visual meshes for a robot: 399,000 vertices take most of a frame's time on a CPU.

Joints, masses and collision shapes stay the same. The result is in the user's cache, named by the content of all source
files.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from vlafuzz.common import assets

if TYPE_CHECKING:
    from trimesh import Trimesh

VERSION = 1  # raise it when the same files result in other meshes
FACES = 0.055  # share that is kept; pictures of 128 pixels look the same, see scripts/bench_render.py
FEWEST = 40  # faces that small parts keep to stay recognisable
SHARP = 0.6  # least angle between two faces at a visible edge, radians


def light_robot(urdf: Path) -> Path:
    """A URDF of the same robot with simplified visual meshes, made by the first call."""
    meshes = [urdf.parent / element.attrib["filename"] for element in _visuals(ElementTree.parse(urdf))]
    digest = hashlib.sha256(f"{VERSION} {FACES} {FEWEST} {SHARP} {urdf}".encode())
    for file in (urdf, *meshes):
        digest.update(file.read_bytes())
    made = {urdf.name, *(file.name for file in meshes)}  # SAPIEN would only log that one is missing
    folder = assets.made_once(
        f"robots/{urdf.stem}-{digest.hexdigest()[:20]}",
        partial(_fill, urdf),
        lambda folder: all((folder / name).is_file() for name in made),
    )
    return folder / urdf.name


def _visuals(tree: ElementTree.ElementTree[ElementTree.Element]) -> Iterator[ElementTree.Element]:
    return tree.iterfind(".//visual/geometry/mesh")


def _fill(urdf: Path, folder: Path) -> None:
    tree = ElementTree.parse(urdf)
    for element in tree.iterfind(".//collision/geometry/mesh"):
        element.set("filename", str(urdf.parent / element.attrib["filename"]))
    for element in _visuals(tree):
        source = urdf.parent / element.attrib["filename"]
        if not (folder / source.name).exists():
            _simplify(source, folder / source.name)
        element.set("filename", source.name)
    tree.write(folder / urdf.name)
    srdf = urdf.with_suffix(".srdf")  # which links may touch each other; SAPIEN reads it from the same folder
    if srdf.is_file():
        shutil.copy(srdf, folder / srdf.name)


def _simplify(source: Path, target: Path) -> None:
    import trimesh

    scene = trimesh.load_scene(source)
    for mesh in scene.geometry.values():
        assert isinstance(mesh, trimesh.Trimesh)
    light = {name: _lighter(mesh) for name, mesh in scene.geometry.items()}
    scene.geometry.clear()
    scene.geometry.update(light)
    target.write_bytes(scene.export(file_type="glb", include_normals=True))


def _lighter(mesh: Trimesh) -> Trimesh:
    """A mesh with fewer faces, smooth except for sharp edges, of the same material."""
    import trimesh

    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    whole.merge_vertices(merge_norm=True, merge_tex=True)
    wanted = max(int(FACES * len(whole.faces)), FEWEST)
    coarse = whole.simplify_quadric_decimation(face_count=wanted) if wanted < len(whole.faces) else whole
    smooth: Trimesh = trimesh.graph.smooth_shade(coarse, angle=SHARP)
    assert isinstance(mesh.visual, trimesh.visual.TextureVisuals)
    smooth.visual = trimesh.visual.TextureVisuals(material=mesh.visual.material)
    return smooth
