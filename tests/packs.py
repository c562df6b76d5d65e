"""Small packs of objects that tests write for themselves."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])  # an axis along z, then along y


def box(*size: float, at: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))


def can(radius: float = 0.03, height: float = 0.12, *, y_up: bool = True) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius, height, sections=24, transform=Y_UP if y_up else None)


def tray() -> trimesh.Trimesh:
    """A floor of 0.2 m x 0.16 m and four walls, 0.04 m high and 0.01 m thick, that share no corner."""
    walls = [box(0.01, 0.16, 0.04, at=(x, 0, 0.02)) for x in (-0.095, 0.095)]
    walls += [box(0.178, 0.01, 0.04, at=(0, y, 0.02)) for y in (-0.075, 0.075)]
    return trimesh.util.concatenate([box(0.198, 0.158, 0.01, at=(0, 0, -0.005)), *walls])


def write_pack(folder: Path, info: str = "info_mine.json", /, **objects: trimesh.Trimesh) -> Path:
    """A folder with these objects, of scale 1 and density 500."""
    for name, mesh in objects.items():
        (folder / "models" / name).mkdir(parents=True)
        mesh.export(folder / "models" / name / "collision.obj")
    facts = {name: {"bbox": {"min": [-9, -9, -9], "max": [9, 9, 9]}, "density": 500} for name in objects}
    (folder / info).write_text(json.dumps(facts))
    return folder
