"""Directions: in which way operators deviate in a failing scene, as few classes as tell causes apart."""

from collections.abc import Iterable

from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.space.operators import CameraPosition, ConfounderType, Light
from vlafuzz.space.params import Gene
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, free_genes

_BESIDE = 1 / 2  # of the largest deviation, as a share of the range: less beside it does not count


def directed(
    space: SearchSpace, scene: Scene, operators: Iterable[str], reference: Scene | None = None
) -> list[str]:
    """Operators with their directions from a reference, by default from nominal: ``light:dark``.

    Numbers have a sign (``+yaw``), the camera's position that of the axis along which it is farthest off
    (``-z``), categories their value (``lying``, ``table-checker``). Confounders have their number and, if it
    matters what they are, their kinds (``1,can``). ``+x2`` is of the second target.
    """
    start = space.nominal(like=scene) if reference is None else reference
    return [f"{name}:{direction(space, scene, name, start)}" for name in operators]


def direction(space: SearchSpace, scene: Scene, name: str, start: Scene) -> str:
    """The direction of one operator from a scene to start from."""
    if name == CONFOUNDERS:
        return ",".join([str(len(scene.confounders)), *_kinds(space, scene, start)])
    if name == Light.name:
        return "dark" if scene.light.intensity < start.light.intensity else "bright"
    if name == CameraPosition.name:
        offsets = zip("xyz", scene.camera.offset, start.camera.offset, strict=True)
        axis, by = max(((axis, a - b) for axis, a, b in offsets), key=lambda moved: abs(moved[1]))
        return _signed(by, axis)
    genes = free_genes(space, scene, GROUPS[name], start)
    values, before = space.values(scene), space.values(start)
    chosen = [_choice(scene, gene, values[gene.path]) for gene in genes if gene.kind == "category"]
    away = {gene: _difference(gene, values[gene.path], before[gene.path]) for gene in genes}
    largest = max(map(abs, away.values()), default=0.0)
    numbers = [_signed(far, _short(gene)) for gene, far in away.items() if abs(far) >= _BESIDE * largest]
    return ",".join(chosen or numbers)


def _kinds(space: SearchSpace, scene: Scene, start: Scene) -> list[str]:
    """The kinds of those confounders that have to be what they are: ``can`` for ``coke_can``."""
    others = space.reset(scene, [ConfounderType.name], start).confounders
    pairs = zip(scene.confounders, others, strict=True)
    return sorted({one.object.rpartition("_")[2] for one, other in pairs if one.object != other.object})


def _choice(scene: Scene, gene: Gene, value: float) -> str:
    _, _, field = gene.path.rpartition(".")
    if gene.options:
        return f"{field}-{gene.options[int(value)]}"
    if field == "rest":
        return scene.targets[int(gene.slot[-1])].rest + _number(gene)
    return str(int(value) + 1)


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
