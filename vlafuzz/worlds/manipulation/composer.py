"""TableComposer: the values of operators to scenes on a table, and back."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from vlafuzz.model import Camera, Gene, Placement, Scene, scene as model
from vlafuzz.model.space import Values
from vlafuzz.worlds.events import MOST, NUMBERS
from vlafuzz.worlds.manipulation.base import Layout

PARTS: dict[str, Any] = {"light": model.Light(), **model.EXTRAS}  # parts of a scene with one gene per field


class TableComposer(ABC):
    """Composes the scenes of one task. A world says how things are placed, and what is said."""

    def __init__(self, task: str, robot: str, layout: Layout, genes: Iterable[Gene]) -> None:
        self._task_name, self._robot, self.layout, self.genes = task, robot, layout, tuple(genes)
        self._parts = {part: [gene for gene in self.genes if gene.slot == part] for part in PARTS}

    @abstractmethod
    def is_free(self, slot: str, name: str, taken: Sequence[str]) -> bool:
        """Whether an object may stand in a slot beside those of the slots before it."""

    @abstractmethod
    def placement(self, values: Mapping[str, float], slot: str, name: str) -> Placement:
        """The placement of an object in a slot."""

    @abstractmethod
    def placed(self, slot: str, placement: Placement) -> Values:
        """The values of what is in a slot; NaN where no index stands for it."""

    @abstractmethod
    def wordings(self, targets: Sequence[str]) -> Sequence[str]:
        """The instructions that a scene with these targets may have."""

    def compose(self, values: Mapping[str, float]) -> Scene:
        """The scene with these values. A name that is taken is replaced by the next free one."""
        slots, names = self.layout.used(int(values["confounders"])), list[str]()
        for slot in slots:
            known, index = self.layout.slots[slot], int(values.get(f"{slot}.object", 0))
            free = (name for name in known[index:] + known[:index] if self.is_free(slot, name, names))
            names.append(next(free, known[index]))
        placed = tuple(self.placement(values, slot, name) for slot, name in zip(slots, names, strict=True))
        targets = len(self.layout.of("targets"))
        return Scene(
            task=self._task_name,
            targets=placed[:targets],
            instruction=self.wordings(names[:targets])[int(values.get("instruction", 0))],
            confounders=placed[targets:],
            robot=self._robot,
            **self.parts(values),
        )

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
        wordings = self.wordings([target.object for target in scene.targets])
        return values | {"instruction": index_of(wordings, scene.instruction)}

    def parts(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Camera, light and extras with these values, by the names of the scene's fields."""
        made = {part: self._part(part, values) for part in PARTS}
        if NUMBERS.get(made["newcomer"].thing, 0) > values["confounders"]:
            made["newcomer"] = model.EVENTS["newcomer"]  # there is no such thing
        events = [part for part, usual in model.EVENTS.items() if made[part] != usual]
        if len(events) > MOST:  # the smallest do not happen
            size = {part: max(gene.distance(values[gene.path]) for gene in self._parts[part]) for part in events}
            made |= {part: model.EVENTS[part] for part in sorted(events, key=size.__getitem__)[:-MOST]}
        return {"camera": camera(values), **made}

    def _part(self, part: str, values: Mapping[str, float]) -> Any:
        nominal, changed = PARTS[part], dict[str, object]()
        if part in model.EVENTS and not any(gene.distance(values[gene.path]) for gene in self._parts[part]):
            return nominal  # at no moment and in no direction
        for gene in self._parts[part]:
            field, value = gene.path.rpartition(".")[2], values[gene.path]
            usual = getattr(nominal, field)
            shown = gene.options[int(value)] if gene.options else type(usual)(value)
            if shown != usual:
                changed[field] = shown
        return replace(nominal, **changed) if changed else nominal


def _value(gene: Gene, part: Any) -> float:
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
