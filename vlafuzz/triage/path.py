"""The path to nominal: operators as triage counts them, and a scene's values step by step."""

from collections.abc import Sequence

from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.space.operators import (
    EXTRAS,
    OPERATORS,
    CameraOrientation,
    CameraPosition,
    ConfounderCount,
    ConfounderOrientation,
    ConfounderPosition,
    ConfounderType,
    Light,
    TargetOrientation,
    TargetPosition,
    Wording,
)
from vlafuzz.space.params import Gene

CONFOUNDERS = "confounders"
# Operators that are reset together, in the order in which triage tries them. Operators 4 to 7 count as one;
# the targets' types are never reset, as they are what a finding is about.
GROUPS: dict[str, tuple[str, ...]] = {
    CONFOUNDERS: (
        ConfounderType.name,
        ConfounderPosition.name,
        ConfounderOrientation.name,
        ConfounderCount.name,
    ),
    **{
        kind.name: (kind.name,)
        for kind in (Light, CameraPosition, CameraOrientation, Wording, TargetOrientation, TargetPosition)
    },
    **{name: (name,) for name in OPERATORS if name in EXTRAS},
}


def deviating(space: SearchSpace, scene: Scene) -> list[str]:
    """The groups that are not nominal in a scene; a SceneError for a value that no operator gives."""
    return [name for name, operators in GROUPS.items() if space.reset(scene, operators) != scene]


def nominal(space: SearchSpace, scene: Scene) -> Scene:
    """The scene with every operator reset but its targets' types."""
    return space.reset(scene, [operator for group in GROUPS.values() for operator in group])


def free_genes(space: SearchSpace, scene: Scene, operators: Sequence[str]) -> list[Gene]:
    """The genes of some operators that are not nominal in a scene; neutral ones are left out."""
    values = space.values(scene)
    genes = [gene for gene in space.by_path.values() if gene.operator in operators and not gene.neutral]
    return [gene for gene in genes if gene.distance(values[gene.path]) > 0 and _in_use(gene, scene)]


def _in_use(gene: Gene, scene: Scene) -> bool:
    part, _, slot = gene.slot.partition(".")
    return part != "confounders" or int(slot) < len(scene.confounders)


class PathToNominal:
    """The path from nominal to a scene along some of its genes, moved together; categories stay as they are.

    Attributes:
        length: number of grid steps of the gene that has farthest to go.
    """

    def __init__(self, space: SearchSpace, scene: Scene, genes: Sequence[Gene]) -> None:
        self._space, self._scene, self._values = space, scene, space.values(scene)
        numbers = [gene for gene in genes if gene.kind != "category"]
        self._away = {gene: _steps(gene, self._values[gene.path]) for gene in numbers}
        self.length = max(map(abs, self._away.values()), default=0)

    def at(self, step: int) -> Scene:
        """The scene at a number of steps from nominal."""
        if step == self.length:
            return self._scene  # off the grid or not
        values = dict(self._values)
        for gene, away in self._away.items():
            grid = gene.grid
            levels = round(away * step / self.length)
            values[gene.path] = grid.value((grid.nominal_level + levels) % grid.size)
        return self._space.composer.compose(values)


def _steps(gene: Gene, value: float) -> int:
    """Number of levels from nominal to a value; angles go the shorter way round."""
    grid = gene.grid
    away = grid.snap(value) - grid.nominal_level
    if grid.wraps:
        away = (away + grid.size // 2) % grid.size - grid.size // 2
    return away
