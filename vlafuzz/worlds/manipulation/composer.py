"""TableComposer: values to scenes of things on a table and back, as far as all worlds do it alike."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from vlafuzz.model.genes import Gene
from vlafuzz.model.scene import EXTRAS, Camera, Light, Placement, Scene
from vlafuzz.model.space import Values
from vlafuzz.worlds.manipulation.base import Layout

REDRAWS = 60  # positions tried for one object
RESTARTS = 200  # attempts at a scene
HINT = "widen the ranges, or lower min_distance, confounder-count or visible, in your own --operators file"
PARTS: dict[str, Any] = {"light": Light(), **EXTRAS}  # parts of a scene with one gene per field


class TableComposer(ABC):
    """Composes the scenes of one task. A world says how things are placed, and what is said."""

    def __init__(self, layout: Layout, genes: Iterable[Gene]) -> None:
        self.layout, self.genes = layout, tuple(genes)
        self._parts = {part: [gene for gene in self.genes if gene.slot == part] for part in PARTS}

    @abstractmethod
    def compose(self, values: Mapping[str, float]) -> Scene:
        """The scene with these values. A name that is taken is replaced by the next free one."""

    @abstractmethod
    def placed(self, slot: str, placement: Placement) -> Values:
        """The values of what is in a slot; NaN where no index stands for it."""

    @abstractmethod
    def wordings(self, scene: Scene) -> Sequence[str]:
        """The instructions that the scene's targets may have."""

    def values(self, scene: Scene) -> Values:
        """The values of everything that a scene has; NaN where no index stands for it."""
        values: Values = {"confounders": len(scene.confounders)}
        for part, genes in self._parts.items():
            values |= {gene.path: _value(gene, getattr(scene, part)) for gene in genes}
        for field in ("distance", "azimuth", "elevation", "roll", "pitch", "yaw"):
            values[f"camera.{field}"] = getattr(scene.camera, field)
        for part, placements in (("targets", scene.targets), ("confounders", scene.confounders)):
            for slot, placement in zip(self.layout.of(part), placements, strict=False):
                values |= self.placed(slot, placement)
        said = math.nan if scene.then else index_of(self.wordings(scene), scene.instruction)
        return values | {"instruction": said}

    def parts(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Camera, light and extras with these values, by the names of the scene's fields."""
        return {"camera": camera(values)} | {part: self._part(part, values) for part in PARTS}

    def _part(self, part: str, values: Mapping[str, float]) -> Any:
        nominal, changed = PARTS[part], dict[str, object]()
        for gene in self._parts[part]:
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
