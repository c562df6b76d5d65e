"""The operators in which a scene differs from its reference, described in words."""

import pathlib

from vlafuzz.errors import SceneError
from vlafuzz.failures.triage.path import Path, free_genes
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.evidence import Causes
from vlafuzz.model.phrasing import failing_range
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import CONFOUNDERS, Space
from vlafuzz.report.view import Deviation
from vlafuzz.rollouts.setup import stored_space
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import Wanted

UNLOCATED = "its threshold did not fit into the rollouts"


def deviations(space: Space, scene: Scene, causes: Causes, reference: Scene | None = None) -> tuple[Deviation, ...]:
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
    values = ((name, space.described(scene, name, other), space.described(other, name, scene)) for name in space.groups)
    return tuple(
        Deviation(name, value, usual, thresholds.get(name, ""), missing.get(name, ""))
        for name, value, usual in values
        if value
    )


def _is_numeric(space: Space, scene: Scene, name: str, other: Scene) -> bool:
    """Whether numbers alone tell an operator's values from the reference's: then it has a threshold."""
    genes = free_genes(space, scene, space.group(name), other)
    categories = name == CONFOUNDERS or any(gene.kind == "category" for gene in genes)
    return not categories and Path(space, scene, genes, other).length > 0


def _nominal(space: Space, scene: Scene) -> Scene:
    try:
        return space.nominal(like=scene)
    except SceneError:  # an imported scene may have targets that no operator produces
        return space.nominal()


def unusual(source: pathlib.Path, scene: Scene, conditions: Conditions) -> list[str]:
    """The operators that are not nominal in a scene, with their values."""
    if conditions.operators_digest:
        space = stored_space(source, conditions)
    else:  # a file of scenes
        space = world_of(scene.task).space(Wanted(task=scene.task, robot=scene.robot))
    return [f"{part.operator}: {part.value}" for part in deviations(space, scene, Causes())]
