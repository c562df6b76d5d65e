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
from vlafuzz.common.reading import read_bytes
from vlafuzz.errors import CatalogueError, VlafuzzError

if TYPE_CHECKING:
    from trimesh import Trimesh

VERSION = 1  # raise it when the same files result in other meshes
FACES = 0.055  # share that is kept; pictures of 128 pixels look the same, see scripts/bench_render.py
FEWEST = 40  # faces that small parts keep to stay recognisable
SHARP = 0.6  # least angle between two faces at a visible edge, radians


def light_robot(urdf: Path) -> Path:
    """A URDF of the same robot with simplified visual meshes, made by the first call.

    A CatalogueError says what of it is missing or damaged.
    """
    try:
        name = f"robots/{urdf.stem}-{_fingerprint(urdf)}"
        folder = assets.made_once(name, partial(_fill, urdf), lambda folder: _is_complete(folder / urdf.name))
    except (VlafuzzError, OSError):
        raise
    except Exception as error:  # of the parsers, for files that somebody changed
        raise CatalogueError(f"{urdf}: no robot: {type(error).__name__}: {error}") from None
    return folder / urdf.name


def _is_complete(urdf: Path) -> bool:
    """Whether all meshes exist, of which SAPIEN would only log the missing ones."""
    if not urdf.is_file():
        return False
    meshes = _visuals(ElementTree.parse(urdf))
    return all((urdf.parent / mesh.attrib["filename"]).is_file() for mesh in meshes)


def _fingerprint(urdf: Path) -> str:
    digest = hashlib.sha256(f"{VERSION} {FACES} {FEWEST} {SHARP} {urdf}".encode())
    digest.update(read_bytes(urdf, CatalogueError))
    for element in _visuals(ElementTree.parse(urdf)):
        digest.update(read_bytes(urdf.parent / element.attrib["filename"], CatalogueError))
    return digest.hexdigest()[:20]


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
