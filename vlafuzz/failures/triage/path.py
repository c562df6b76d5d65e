"""Ways to a failing scene: the operators in which it deviates, in which directions, and its values step by step."""

from collections.abc import Iterable, Iterator, Sequence

from vlafuzz.model import Gene, Scene, Space
from vlafuzz.model.space import CONFOUNDERS, Values

_BESIDE = 1 / 2  # of the largest deviation, as a share of the range: less beside it does not count
_PLACES = 3  # that are farther out than a scene; the last one is the end of the range


def deviating(space: Space, scene: Scene, reference: Scene | None = None) -> list[str]:
    """The groups in which a scene differs from a reference, by default from nominal.

    Raises:
        SceneError: a value that no operator gives.
    """
    return [name for name, operators in space.groups.items() if space.reset(scene, operators, reference) != scene]


def free_genes(space: Space, scene: Scene, operators: Sequence[str], reference: Scene | None = None) -> list[Gene]:
    """The genes of some operators in which a scene differs from a reference, by default from nominal.

    The direction of a displacement counts only where both are displaced.
    """
    values, start = space.values(scene), start_values(space, reference)
    both = _severe(space, values) & _severe(space, start)
    used = {f"{CONFOUNDERS}.{slot}" for slot in range(len(space.things(scene)))}
    return [
        gene
        for path, gene in space.by_path.items()
        if gene.operator in operators
        and (gene.operator in both or not gene.neutral)
        and values[path] != start[path]
        and not (gene.grid.wraps and (values[path] - start[path]) % 360.0 == 0)
        and (not gene.slot.startswith(CONFOUNDERS) or gene.slot in used)
    ]


def start_values(space: Space, reference: Scene | None) -> Values:
    """The values of a reference, by default the nominal ones."""
    return space.nominal_values if reference is None else space.values(reference)


def _severe(space: Space, values: Values) -> set[str]:
    return {gene.operator for path, gene in space.by_path.items() if gene.distance(values[path]) > 0}


class Path:
    """The path from a reference to a scene along some genes, moved together; categories stay as they are.

    Attributes:
        length: number of grid steps of the gene that has farthest to go.
        end: the last step beyond the scene, in the same direction, at which every gene is in its range.
    """

    def __init__(self, space: Space, scene: Scene, genes: Sequence[Gene], reference: Scene | None = None) -> None:
        self._space, self._scene = space, scene
        self._values, self._start = space.values(scene), start_values(space, reference)
        self._away = {
            gene: steps(gene, self._start[gene.path], self._values[gene.path])
            for gene in genes
            if gene.kind != "category"
        }
        self.length = max(map(abs, self._away.values()), default=0)
        reaches = (
            _room(gene, self._start[gene.path], away) * self.length // abs(away)
            for gene, away in self._away.items()
            if away
        )
        self.end = max(min(reaches, default=0), self.length)

    def at(self, step: int) -> Scene:
        """The scene at a number of steps from the reference, at most ``end``."""
        if step == self.length:
            return self._scene  # off the grid or not
        values = dict(self._values)
        for gene, away in self._away.items():
            grid = gene.grid
            level = grid.snap(self._start[gene.path]) + round(away * step / self.length)
            values[gene.path] = grid.value(level % grid.size) if step else self._start[gene.path]
        return self._space.compose(values)


def steps(gene: Gene, start: float, value: float) -> int:
    """Number of levels from one value to another; angles go the shorter way round."""
    grid = gene.grid
    away = grid.snap(value) - grid.snap(start)
    if grid.wraps:
        away = (away + grid.size // 2) % grid.size - grid.size // 2
    return away


def _room(gene: Gene, start: float, away: int) -> int:
    """Number of levels from a value to the end of its range in one direction; of angles, to half a turn."""
    level, size = gene.grid.snap(start), gene.grid.size
    if gene.grid.wraps:
        return size // 2
    return size - 1 - level if away > 0 else level


def directed(space: Space, scene: Scene, operators: Iterable[str], reference: Scene | None = None) -> list[str]:
    """Operators with their directions from a reference, by default from nominal: ``light:dark``.

    Numbers have a sign (``+yaw``), the camera's position that of the axis along which it is farthest off (``-z``),
    categories their value (``lying``, ``table-checker``). Confounders have their number and, if it matters what they
    are, their kinds (``1,can``). ``+x2`` is of the second target.
    """
    start = space.nominal(like=scene) if reference is None else reference
    return [f"{name}:{direction(space, scene, name, start)}" for name in operators]


def direction(space: Space, scene: Scene, name: str, start: Scene) -> str:
    """The direction of one operator from a scene to start from."""
    if (own := space.direction(scene, name, start)) is not None:
        return own
    if name == space.subject:  # which the scene to start from may have in common
        return ",".join(space.subjects(scene))
    genes = free_genes(space, scene, space.group(name), start)
    values, before = space.values(scene), space.values(start)
    chosen = [space.option(scene, gene, values[gene.path]) for gene in genes if gene.kind == "category"]
    away = {gene: _difference(gene, values[gene.path], before[gene.path]) for gene in genes}
    largest = max(map(abs, away.values()), default=0.0)
    numbers = [_signed(gene, far) for gene, far in away.items() if abs(far) >= _BESIDE * largest]
    return ",".join(chosen or numbers)


def _difference(gene: Gene, value: float, start: float) -> float:
    """How far a value is from another one, as a share of the range; angles the shorter way round."""
    away = value - start
    if gene.grid.wraps:
        away = (away + 180.0) % 360.0 - 180.0
    return away / (gene.grid.high - gene.grid.low)


def _signed(gene: Gene, far: float) -> str:
    """A number with its sign: nothing behind its name for the first target, ``2`` for the second."""
    part, _, slot = gene.slot.partition(".")
    number = str(int(slot) + 1) if part == "targets" and slot != "0" else ""
    return f"{'-' if far < 0 else '+'}{gene.path.rpartition('.')[2]}{number}"


def outward(space: Space, scene: Scene, operators: Sequence[str]) -> Iterator[Scene]:
    """Scenes farther out than a failing one, the nearest first: there a policy fails more surely than near a threshold.

    Args:
        operators: that move away from nominal, the confounders' as one, which stay; all others keep their values.
    """
    start = space.nominal(like=scene)
    numeric = [operator for name in operators if name != CONFOUNDERS for operator in space.group(name)]
    path = Path(space, scene, free_genes(space, scene, numeric, start), start)
    steps = {path.length + (path.end - path.length) * place // _PLACES for place in range(1, _PLACES + 1)}
    directions = directed(space, scene, operators)
    for step in sorted(steps - {path.length}):
        moved = path.at(step)
        if directed(space, moved, operators) == directions:
            yield moved
