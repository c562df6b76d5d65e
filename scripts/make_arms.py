#!/usr/bin/env python3
"""Write worlds/manipulation/arms.json: joints and convex bodies of the robots, to see what they hide.

The Panda's links become hulls of a few corners; those of the other robots, whose files are not ours, become boxes that
are measured on slices of them, to 5 mm.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, parse

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from vlafuzz.worlds.manipulation.rigs import GOOGLE, WIDOWX

Array = NDArray[np.float64]
CORNERS = 24
STEP = 0.005  # metres
SLICE = 0.06  # metres, along the longest side
OUT = Path(__file__).parent.parent / "vlafuzz" / "worlds" / "manipulation" / "arms.json"
PANDA = tuple(f"panda_{name}" for name in (*(f"joint{n}" for n in range(1, 8)), "finger_joint1", "finger_joint2"))


def hull(points: Array) -> list[Array]:
    """Those corners of the convex hull that stick out most in evenly spread directions."""
    number = np.arange(600) + 0.5
    polar, around = np.arccos(1 - number / 300), np.pi * (1 + 5**0.5) * number
    ways = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])
    corners = points[ConvexHull(points).vertices]
    reach = corners @ ways
    chosen = [int(reach[:, 0].argmax())]
    while len(chosen) < CORNERS:
        chosen.append(int((reach - reach[chosen].max(axis=0)).max(axis=1).argmax()))
    return [np.asarray(corners[chosen])]


def boxes(points: Array) -> list[Array]:
    """The corners of the bounding boxes of slices across the longest side, rounded."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    longest = int(size.argmax())
    number = np.floor((points[:, longest] - low[longest]) / SLICE).astype(int)
    slices = [points[number == index] for index in np.unique(number)]
    edges = [np.round(np.stack([part.min(axis=0), part.max(axis=0)]) / STEP) * STEP for part in slices]
    return [np.array(list(product(*span.T))) for span in edges]


def numbers(element: Element | None, key: str, default: str = "0 0 0") -> list[float]:
    text = default if element is None else element.get(key, default)
    return [round(float(part), 6) for part in text.split()]


def points_of(link: Element, folder: Path) -> Array:
    """Points on the surface of all visual meshes of a link, vertices included."""
    points: list[Array] = [np.zeros((0, 3))]
    for visual in link.iterfind("visual"):
        mesh, origin = visual.find("geometry/mesh"), visual.find("origin")
        if mesh is not None:
            turn = Rotation.from_euler("xyz", numbers(origin, "rpy")).as_matrix()
            drawn: Any = trimesh.load_scene(folder / mesh.attrib["filename"]).to_geometry()
            surface = trimesh.sample.sample_surface(drawn, 4000, seed=0)[0]
            corners = np.concatenate([drawn.vertices, surface])
            points.append(corners * numbers(mesh, "scale", "1 1 1") @ turn.T + numbers(origin, "xyz"))
    return np.concatenate(points)


def links(urdf: Path, moving: tuple[str, ...], solid: Callable[[Array], list[Array]]) -> Iterator[dict[str, Any]]:
    """The links from the base on: the number of the parent, the joint, and convex bodies if there are any.

    ``moving``: names of the joints in the order of the rig's ``rest``.
    """
    tree = parse(urdf)
    joints = {joint.find("child").attrib["link"]: joint for joint in tree.iterfind("joint")}  # type: ignore[union-attr]
    left = {link.attrib["name"]: link for link in tree.iterfind("link")}
    order: list[str] = []
    while left:
        for name in list(left):
            joint = joints.get(name)
            parent = None if joint is None else joint.find("parent").attrib["link"]  # type: ignore[union-attr]
            if parent in left:
                continue
            row: dict[str, Any] = {"parent": order.index(parent) if parent else None}
            if joint is not None:
                row |= {key: numbers(joint.find("origin"), key) for key in ("xyz", "rpy")}
                if joint.attrib["name"] in moving:
                    kind = "slide" if joint.attrib["type"] == "prismatic" else "turn"
                    row |= {kind: numbers(joint.find("axis"), "xyz"), "joint": moving.index(joint.attrib["name"])}
            points = points_of(left.pop(name), urdf.parent)
            order.append(name)
            yield row | ({"bodies": [body.round(4).tolist() for body in solid(points)]} if len(points) else {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", type=Path, help="a pack's folder robots/, for WidowX and Google robot")
    options = parser.parse_args()
    from mani_skill.agents.robots.panda import Panda

    made = {"panda": links(Path(Panda.urdf_path), PANDA, hull)}
    made |= {rig.robot: links(options.robots / str(rig.urdf), rig.joints, boxes) for rig in (WIDOWX, GOOGLE)}
    rows = [f'"{name}": [\n' + ",\n".join(map(json.dumps, robot)) + "\n]" for name, robot in made.items()]
    OUT.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
