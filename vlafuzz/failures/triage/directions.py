"""Directions: in which way operators deviate in a failing scene, as few classes as tell causes apart."""

from collections.abc import Iterable

from vlafuzz.failures.triage.path import free_genes
from vlafuzz.model.genes import Gene
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space

_BESIDE = 1 / 2  # of the largest deviation, as a share of the range: less beside it does not count


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
    genes = free_genes(space, scene, space.group(name), start)
    values, before = space.values(scene), space.values(start)
    chosen = [space.option(scene, gene, values[gene.path]) for gene in genes if gene.kind == "category"]
    away = {gene: _difference(gene, values[gene.path], before[gene.path]) for gene in genes}
    largest = max(map(abs, away.values()), default=0.0)
    numbers = [_signed(far, _short(gene)) for gene, far in away.items() if abs(far) >= _BESIDE * largest]
    return ",".join(chosen or numbers)


def _difference(gene: Gene, value: float, start: float) -> float:
    """How far a value is from another one, as a share of the range; angles the shorter way round."""
    away = value - start
    if gene.grid.wraps:
        away = (away + 180.0) % 360.0 - 180.0
    return away / (gene.grid.high - gene.grid.low)


def _short(gene: Gene) -> str:
    return gene.path.rpartition(".")[2] + _number(gene)


def _number(gene: Gene) -> str:
    """Nothing for the first target, ``2`` for the second."""
    part, _, slot = gene.slot.partition(".")
    return str(int(slot) + 1) if part == "targets" and slot != "0" else ""


def _signed(by: float, name: str) -> str:
    return f"{'-' if by < 0 else '+'}{name}"
