#!/usr/bin/env python3
"""Write vlafuzz/rigs/arms.json: convex bodies and joints of the robots, as the visibility check needs them.

The Panda's links become hulls of at most 24 corners; those of other robots, whose files are not ours, boxes
that were measured on them, rounded to 5 mm.
"""

import argparse
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import GOOGLE, PANDA, WIDOWX

Array = NDArray[np.float64]
CORNERS = 24
OUT = Path(__file__).parent.parent / "vlafuzz" / "rigs" / "arms.json"


def numbers(element: ElementTree.Element | None, key: str, default: str = "0 0 0") -> list[float]:
    text = default if element is None else element.get(key, default)
    return [round(float(part), 6) for part in text.split()]


def placed(origin: ElementTree.Element | None, points: Array) -> Array:
    turn = Rotation.from_euler("xyz", numbers(origin, "rpy")).as_matrix()
    return np.asarray(points @ turn.T + numbers(origin, "xyz"))


def hull(points: Array) -> Array:
    """The corners of a convex hull that are farthest out in evenly spread directions."""
    number = np.arange(600) + 0.5
    polar, around = np.arccos(1 - 2 * number / 600), np.pi * (1 + 5**0.5) * number
    ways = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])
    corners = points[ConvexHull(points).vertices]
    chosen = [int(np.argmax(corners[:, 0]))]
    while len(chosen) < CORNERS:  # next the corner that sticks out most beyond those chosen
        beyond = (corners @ ways) - (corners[chosen] @ ways).max(axis=0)
        far = int(np.argmax(beyond.max(axis=1)))
        if far in chosen:
            break
        chosen.append(far)
    return np.round(corners[chosen], 4)


def box(points: Array) -> Array:
    low, high = (np.round(edge / 0.005) * 0.005 for edge in (points.min(axis=0), points.max(axis=0)))
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def links(urdf: Path, rig: Rig, names: tuple[str, ...], boxes: bool) -> list[dict[str, Any]]:
    """Links from the base on, each with its parent's number, its joint and its convex bodies."""
    tree = ElementTree.parse(urdf)
    joints = {joint.find("child").get("link"): joint for joint in tree.iterfind("joint")}
    order: list[str] = []
    bodies = {link.get("name"): list(link.iterfind("visual")) for link in tree.iterfind("link")}

    def visit(name: str) -> None:
        joint = joints.get(name)
        if joint is not None and joint.find("parent").get("link") not in order:
            visit(joint.find("parent").get("link"))
        if name not in order:
            order.append(name)

    for name in bodies:
        visit(str(name))
    rows = []
    for name in order:
        joint = joints.get(name)
        points = []
        for visual in bodies[name]:
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            corners = trimesh.load_scene(urdf.parent / mesh.get("filename")).to_geometry().vertices
            points.append(placed(visual.find("origin"), corners * numbers(mesh, "scale", "1 1 1")))
        whole = np.concatenate(points) if points else np.zeros((0, 3))
        row: dict[str, Any] = {"parent": None, "xyz": [0, 0, 0], "rpy": [0, 0, 0]}
        if joint is not None:
            origin = joint.find("origin")
            row |= {
                "parent": order.index(joint.find("parent").get("link")),
                "xyz": numbers(origin, "xyz"),
                "rpy": numbers(origin, "rpy"),
            }
            if joint.get("name") in names:
                kind = "slide" if joint.get("type") == "prismatic" else "turn"
                row |= {kind: numbers(joint.find("axis"), "xyz"), "joint": names.index(joint.get("name"))}
        if len(whole):
            row["body"] = (box(whole) if boxes else hull(whole)).round(4).tolist()
        rows.append(row)
    needed = {index for index, row in enumerate(rows) if "body" in row}
    for index in reversed(range(len(rows))):
        if index in needed and rows[index]["parent"] is not None:
            needed.add(rows[index]["parent"])
    kept = sorted(needed)
    return [
        rows[index] | {"parent": None if rows[index]["parent"] is None else kept.index(rows[index]["parent"])}
        for index in kept
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=Path, help="a pack's folder robots/, for WidowX and Google robot")
    options = parser.parse_args()
    from mani_skill.agents.robots.panda import Panda

    panda = (*(f"panda_joint{number}" for number in range(1, 8)), "panda_finger_joint1", "panda_finger_joint2")
    made = json.loads(OUT.read_text()) if OUT.exists() else {}
    made["panda"] = links(Path(Panda.urdf_path), PANDA, panda, boxes=False)
    if options.robots:
        for rig in (WIDOWX, GOOGLE):
            made[rig.robot] = links(options.robots / str(rig.urdf), rig, rig.joints, boxes=True)
    rows = (f'"{name}": [\n' + ",\n".join(json.dumps(row) for row in robot) + "\n]" for name, robot in made.items())
    OUT.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
