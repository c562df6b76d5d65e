"""The shipped Panda: ManiSkill's with another look, and nothing else."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from mani_skill.agents.robots.panda import Panda

from vlafuzz.worlds.tabletop.sim.robots import MetricPanda

STOCK, OURS = Path(Panda.urdf_path), Path(MetricPanda.urdf_path)
MOST_VERTICES = 10_000
PIXEL = 0.007  # metres on the table, in a picture of 128 pixels


def files(urdf: Path, kind: str) -> list[Path]:
    """Of all visual or collision meshes, in the robot's order."""
    meshes = ElementTree.parse(urdf).getroot().iterfind(f".//{kind}/geometry/mesh")
    return [(urdf.parent / mesh.attrib["filename"]).resolve() for mesh in meshes]


def described(urdf: Path) -> str:
    """Everything in the file, without the folders of meshes."""
    robot = ElementTree.parse(urdf).getroot()
    for mesh in robot.iterfind(".//mesh"):
        mesh.set("filename", Path(mesh.attrib["filename"]).name)
    return ElementTree.canonicalize(ElementTree.tostring(robot, "unicode"), strip_text=True)


def test_only_the_visual_meshes_are_others_than_stocks():
    assert described(OURS) == described(STOCK)
    assert OURS.with_suffix(".srdf").read_bytes() == STOCK.with_suffix(".srdf").read_bytes()
    for ours, stock in zip(files(OURS, "collision"), files(STOCK, "collision"), strict=True):
        assert ours.read_bytes() == stock.read_bytes()


def test_every_part_keeps_its_colours_and_to_a_pixel_its_size_with_few_vertices():
    vertices = [0, 0]
    for pair in zip(files(OURS, "visual"), files(STOCK, "visual"), strict=True):
        ours, stock = map(trimesh.load_scene, pair)
        assert np.abs(ours.bounds - stock.bounds).max() < PIXEL
        parts = [list(part.geometry.values()) for part in (ours, stock)]
        colours = [[mesh.visual.material.main_color.tolist() for mesh in meshes] for meshes in parts]
        assert colours[0] == colours[1]
        added = (sum(len(mesh.vertices) for mesh in part.geometry.values()) for part in (ours, stock))
        vertices = [n + more for n, more in zip(vertices, added, strict=True)]
    assert vertices[0] < MOST_VERTICES < vertices[1] / 20
