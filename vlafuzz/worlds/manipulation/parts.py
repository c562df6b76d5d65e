"""Parts of a scene with one gene a field: camera, light and extras."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from vlafuzz.model.genes import Gene
from vlafuzz.model.scene import EXTRAS, Camera, Light, Scene
from vlafuzz.model.space import Values

REDRAWS = 60  # positions tried for one object
RESTARTS = 200  # attempts at a scene
HINT = "widen the ranges, or lower min_distance, confounder-count or visible, in your own --operators file"
PARTS: dict[str, Any] = {"light": Light(), **EXTRAS}  # parts of a scene with one gene per field


class Parts:
    """Camera, light and extras of a scene."""

    def __init__(self, genes: Sequence[Gene]) -> None:
        self._genes = {part: [gene for gene in genes if gene.slot == part] for part in PARTS}

    def values(self, scene: Scene) -> Values:
        """Their values in a scene."""
        values: Values = {}
        for part, genes in self._genes.items():
            values |= {gene.path: _value(gene, getattr(scene, part)) for gene in genes}
        for field in ("distance", "azimuth", "elevation", "roll", "pitch", "yaw"):
            values[f"camera.{field}"] = getattr(scene.camera, field)
        return values

    def composed(self, values: Mapping[str, float]) -> dict[str, Any]:
        """The parts with these values, by the names of the scene's fields."""
        return {"camera": camera(values)} | {part: self._composed(part, values) for part in PARTS}

    def _composed(self, part: str, values: Mapping[str, float]) -> Any:
        nominal, changed = PARTS[part], dict[str, object]()
        for gene in self._genes[part]:
            field, value = gene.path.rpartition(".")[2], values[gene.path]
            usual = getattr(nominal, field)
            shown = gene.options[int(value)] if gene.options else type(usual)(value)
            if shown != usual:
                changed[field] = shown
        return replace(nominal, **changed) if changed else nominal


def _value(gene: Gene, part: Any) -> float:
    """The value of a gene in a part of a scene."""
    shown = getattr(part, gene.path.rpartition(".")[2])
    return index_of(gene.options, shown) if gene.options else float(shown)


def camera(values: Mapping[str, float]) -> Camera:
    """The camera with these values; equivalent directions are written with zeros."""
    distance, elevation = values["camera.distance"], values["camera.elevation"]
    azimuth = 0.0 if distance == 0 or abs(elevation) == 90 else values["camera.azimuth"]
    turned = {axis: values[f"camera.{axis}"] for axis in ("roll", "pitch", "yaw")}
    return Camera(distance, azimuth, 0.0 if distance == 0 else elevation, **turned)


def index_of(known: Sequence[str], name: str) -> float:
    """The index of a name among those that are known; NaN if it is not."""
    return known.index(name) if name in known else math.nan
