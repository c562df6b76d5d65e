"""The operators in which a scene differs from its reference, described in words."""

import math
import pathlib
from collections.abc import Iterable, Sequence
from dataclasses import fields

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.stored import stored_catalogue
from vlafuzz.errors import SceneError
from vlafuzz.evidence import Causes
from vlafuzz.phrasing import failing_range
from vlafuzz.report.view import Deviation
from vlafuzz.scene import Camera, Placement, Scene, in_words
from vlafuzz.space import SearchSpace, load_operators
from vlafuzz.space.extras import BystanderOrientation, BystanderPosition, Extra
from vlafuzz.space.operators import (
    OPERATORS,
    CameraOrientation,
    CameraPosition,
    Light,
    TargetOrientation,
    TargetPosition,
    Wording,
)
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, Path, free_genes
from vlafuzz.worlds import stored_space

UNLOCATED = "its threshold did not fit into the rollouts"


def deviations(
    space: SearchSpace, scene: Scene, causes: Causes, reference: Scene | None = None
) -> tuple[Deviation, ...]:
    """One for every operator in which a scene differs from a reference, by default from nominal.

    The confounder operators count as one.
    """
    other = reference or _nominal(space, scene)
    thresholds = {threshold.operator: failing_range(threshold) for threshold in causes.thresholds}
    missing = {
        name: UNLOCATED
        for name in causes.necessary
        if name not in thresholds and _is_numeric(space, scene, name, other)
    }
    slots = {name: _targets_of(space, name) for name in GROUPS}
    values = (
        (name, _value(name, scene, other, on), _value(name, other, scene, on)) for name, on in slots.items()
    )
    return tuple(
        Deviation(name, value, usual, thresholds.get(name, ""), missing.get(name, ""))
        for name, value, usual in values
        if value
    )


def _is_numeric(space: SearchSpace, scene: Scene, name: str, other: Scene) -> bool:
    """Whether numbers alone tell an operator's values from the reference's: then it has a threshold."""
    genes = free_genes(space, scene, GROUPS[name], other)
    categories = name == CONFOUNDERS or any(gene.kind == "category" for gene in genes)
    return not categories and Path(space, scene, genes, other).length > 0


def _nominal(space: SearchSpace, scene: Scene) -> Scene:
    try:
        return space.nominal(like=scene)
    except SceneError:  # an imported scene may have targets that no operator produces
        return space.nominal()


def _targets_of(space: SearchSpace, name: str) -> list[int]:
    """The numbers of the targets that an operator is about."""
    slots = {gene.slot for gene in space.by_path.values() if gene.operator == name}
    return sorted(int(slot.partition(".")[2]) for slot in slots if slot.startswith("targets"))


def _value(operator: str, scene: Scene, other: Scene, slots: Sequence[int]) -> str:
    """An operator's values in a scene where they differ from the other scene; empty if none does."""
    if operator == CONFOUNDERS:
        same = scene.confounders == other.confounders
        return "" if same else "; ".join(map(_described, scene.confounders)) or "none"
    if operator == Light.name:
        return "" if scene.light == other.light else f"× {scene.light.intensity:.3g}"
    if operator == CameraPosition.name:
        same = scene.camera.offset == other.camera.offset
        return "" if same else _offset(scene.camera)
    if operator == CameraOrientation.name:
        return _fields(scene.camera, other.camera, ("roll", "pitch", "yaw"))
    if operator == Wording.name:
        same = scene.instructions == other.instructions
        return "" if same else f"“{' / '.join(scene.instructions)}”"
    kind = OPERATORS[operator]
    if issubclass(kind, Extra) and kind.part != "targets":
        shown, usual = getattr(scene, kind.part), getattr(other, kind.part)
        return _fields(shown, usual, [field.name for field in fields(shown)])
    return _targets(operator, scene.targets, other.targets, slots)


def _targets(
    operator: str, targets: Sequence[Placement], others: Sequence[Placement], slots: Sequence[int]
) -> str:
    parts = []
    for target, other in [
        pair for slot, pair in enumerate(zip(targets, others, strict=False)) if slot in slots
    ]:
        words = list(_words(operator, target, other))
        if words:
            parts.append((f"{_name(target)}: " if len(targets) > 1 else "") + ", ".join(words))
    return "; ".join(parts)


def _words(operator: str, target: Placement, other: Placement) -> Iterable[str]:
    if operator in (TargetPosition.name, BystanderPosition.name) and (target.x, target.y) != (
        other.x,
        other.y,
    ):
        yield f"x {target.x:g} m, y {target.y:g} m"
    if operator in (TargetOrientation.name, BystanderOrientation.name):
        if target.rest != other.rest:
            yield f"rests {target.rest}"
        if target.yaw != other.yaw:
            yield f"yaw {target.yaw:g}°"
        if target.quaternion != other.quaternion:
            yield "turned freely" if target.quaternion else f"rests {target.rest}"


def _described(placement: Placement) -> str:
    return f"{_name(placement)} at x {placement.x:g} m, y {placement.y:g} m"


def _name(placement: Placement) -> str:
    return placement.object.replace("_", " ")


def _offset(camera: Camera) -> str:
    if math.isclose(camera.distance, 0):
        return "0 m off"
    return f"{camera.distance:g} m off, azimuth {camera.azimuth:g}°, elevation {camera.elevation:g}°"


def _fields(part: object, other: object, names: Sequence[str]) -> str:
    """The fields of a part of a scene that differ from another's."""
    differing = [name for name in names if getattr(part, name) != getattr(other, name)]
    return ", ".join(in_words(name, getattr(part, name)) for name in differing)


def unusual(source: pathlib.Path, scene: Scene, conditions: Conditions) -> list[str]:
    """The operators that are not nominal in a scene, with their values."""
    if conditions.operators_digest:
        space = stored_space(source, conditions)
    else:  # a file of scenes
        catalogue = stored_catalogue(conditions)
        space = SearchSpace(load_operators(), catalogue, conditions.task, scene.robot)
    return [f"{part.operator}: {part.value}" for part in deviations(space, scene, Causes())]
