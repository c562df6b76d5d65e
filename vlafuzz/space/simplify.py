"""Steps toward nominal: what a shrinker tries, the largest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from vlafuzz.scene import Scene
from vlafuzz.space.compose import Values
from vlafuzz.space.params import Gene

if TYPE_CHECKING:
    from vlafuzz.space.codec import SearchSpace

_ROUNDING = 1e-12  # severities are sums of square roots


def simpler(space: SearchSpace, scene: Scene) -> list[Scene]:
    """The scenes one simplification away, each once and each strictly less severe; none at nominal only.

    An operator is reset, a confounder left out, a value moved halfway to nominal, a value moved by one step.
    Whether such a scene is fair is not looked at.

    Raises:
        SceneError: the scene has something that is not a value of any operator.
    """
    before = space.severity(scene)
    found: dict[Scene, None] = {}
    for candidate in _candidates(space, scene):
        if candidate not in found and space.severity(candidate) < before - _ROUNDING:
            found[candidate] = None
    return list(found)


def _candidates(space: SearchSpace, scene: Scene) -> Iterator[Scene]:
    for name, severity in space.severities(scene).items():
        if severity > 0:
            yield space.reset(scene, [name])
    yield from _with_one_less(scene)
    values = space.values(scene)
    for share in (0.5, 0.0):
        for path, gene in space.by_path.items():
            if not gene.neutral and values[path] != gene.grid.nominal:
                yield space.composer.compose(_moved(values, gene, share))


def _with_one_less(scene: Scene) -> Iterator[Scene]:
    """Without one confounder: the others move up, or the last one takes its place."""
    around = scene.confounders
    for index in range(len(around)):
        yield replace(scene, confounders=around[:index] + around[index + 1 :])
        if index < len(around) - 2:
            yield replace(scene, confounders=(*around[:index], around[-1], *around[index + 1 : -1]))


def _moved(values: Values, gene: Gene, share: float) -> Values:
    """One value nearer to nominal, by a share of its way, at least by a step; of a category, all the way."""
    grid = gene.grid
    away = grid.snap(values[gene.path]) - grid.nominal_level
    if grid.wraps:
        away = (away + grid.size // 2) % grid.size - grid.size // 2
    steps = abs(away) if gene.kind == "category" else max(round(share * abs(away)), 1)
    nearer = abs(away) - min(steps, abs(away))
    return values | {
        gene.path: grid.value((grid.nominal_level + (nearer if away > 0 else -nearer)) % grid.size)
    }
