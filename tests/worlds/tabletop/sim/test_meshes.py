"""The simplified robot: another look, and nothing else."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from mani_skill.agents.robots.panda import Panda

from vlafuzz.worlds.tabletop.sim import meshes
from vlafuzz.worlds.tabletop.sim.meshes import light_robot

STOCK = Path(Panda.urdf_path)
MOST_VERTICES = 10_000
PIXEL = 0.007  # metres on the table, in a picture of 128 pixels


@pytest.fixture(scope="module")
def light(tmp_path_factory) -> Path:
    """Made anew, in a cache of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VLAFUZZ_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield light_robot(STOCK)


def root(urdf: Path) -> ElementTree.Element:
    return ElementTree.parse(urdf).getroot()


def files(urdf: Path, kind: str) -> list[Path]:
    """Of all visual or collision meshes, in the robot's order."""
    meshes = root(urdf).iterfind(f".//{kind}/geometry/mesh")
    return [(urdf.parent / mesh.attrib["filename"]).resolve() for mesh in meshes]


def described(urdf: Path) -> str:
    """Everything in the file, without the folders of meshes."""
    robot = root(urdf)
    for mesh in robot.iterfind(".//mesh"):
        mesh.set("filename", Path(mesh.attrib["filename"]).name)
    return ElementTree.canonicalize(ElementTree.tostring(robot, "unicode"), strip_text=True)


def test_only_the_visual_meshes_are_others_than_stocks(light):
    assert described(light) == described(STOCK)
    assert files(light, "collision") == files(STOCK, "collision")
    assert not set(files(light, "visual")) & set(files(STOCK, "visual"))
    assert light.with_suffix(".srdf").read_bytes() == STOCK.with_suffix(".srdf").read_bytes()


def test_it_is_made_once(light, monkeypatch):
    monkeypatch.setattr(meshes, "_simplify", lambda *_: pytest.fail("made again"))
    assert light_robot(STOCK) == light


def test_it_has_few_vertices(light):
    def vertices(urdf: Path) -> int:
        parts = (trimesh.load_scene(file).geometry.values() for file in files(urdf, "visual"))
        return sum(len(mesh.vertices) for meshes in parts for mesh in meshes)

    assert vertices(light) < MOST_VERTICES < vertices(STOCK) / 20


def test_every_part_keeps_its_colours_and_to_a_pixel_its_size(light):
    for pair in zip(files(light, "visual"), files(STOCK, "visual"), strict=True):
        ours, stock = map(trimesh.load_scene, pair)
        assert np.abs(ours.bounds - stock.bounds).max() < PIXEL
        colours = [
            [mesh.visual.material.main_color.tolist() for mesh in part.geometry.values()] for part in (ours, stock)
        ]
        assert colours[0] == colours[1]


def test_what_lacks_a_file_is_made_again(light):
    names = {file.name for file in light.parent.iterdir()}
    (light.parent / "hand.glb").unlink()
    assert light_robot(STOCK) == light
    assert {file.name for file in light.parent.iterdir()} == names
    assert [path.name for path in light.parent.parent.iterdir()] == [light.parent.name]  # no drafts left
