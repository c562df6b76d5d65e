#!/usr/bin/env python3
"""Write operators/robots/panda: ManiSkill's Panda with simplified visual meshes.

Its own have 399,000 vertices, which take most of a frame's time on a CPU. Joints, masses and collision shapes stay the
same. ManiSkill's files are those of franka_description (Apache-2.0).
"""

import shutil
from pathlib import Path
from xml.etree import ElementTree

import trimesh
from mani_skill.agents.robots.panda import Panda

OUT = Path(__file__).parent.parent / "operators" / "robots" / "panda"
FACES = 0.055  # share that is kept; pictures of 128 pixels look the same, see scripts/bench_render.py
FEWEST = 40  # faces that small parts keep to stay recognisable
SHARP = 0.6  # least angle between two faces at a visible edge, radians


def simplify(source: Path, target: Path) -> None:
    scene = trimesh.load_scene(source)
    light = {name: lighter(mesh) for name, mesh in scene.geometry.items() if isinstance(mesh, trimesh.Trimesh)}
    scene.geometry.clear()
    scene.geometry.update(light)
    target.write_bytes(scene.export(file_type="glb", include_normals=True))


def lighter(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A mesh with fewer faces, smooth except for sharp edges, of the same material."""
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    whole.merge_vertices(merge_norm=True, merge_tex=True)
    wanted = max(int(FACES * len(whole.faces)), FEWEST)
    coarse = whole.simplify_quadric_decimation(face_count=wanted) if wanted < len(whole.faces) else whole
    smooth: trimesh.Trimesh = trimesh.graph.smooth_shade(coarse, angle=SHARP)
    assert isinstance(mesh.visual, trimesh.visual.TextureVisuals)
    smooth.visual = trimesh.visual.TextureVisuals(material=mesh.visual.material)
    return smooth


def main() -> None:
    urdf = Path(Panda.urdf_path)
    shutil.rmtree(OUT, ignore_errors=True)
    tree = ElementTree.parse(urdf)
    for kind, write in (("visual", simplify), ("collision", shutil.copyfile)):
        (OUT / kind).mkdir(parents=True)
        for element in tree.iterfind(f".//{kind}/geometry/mesh"):
            source = urdf.parent / element.attrib["filename"]
            element.set("filename", f"{kind}/{source.name}")
            if not (OUT / kind / source.name).exists():
                write(source, OUT / kind / source.name)
    tree.write(OUT / urdf.name)
    shutil.copyfile(urdf.with_suffix(".srdf"), OUT / urdf.with_suffix(".srdf").name)  # which links may touch each other


if __name__ == "__main__":
    main()
