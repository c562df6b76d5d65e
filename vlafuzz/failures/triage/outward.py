"""Outward: a failing scene farther from its reference, by the same operators in the same directions.

Near a threshold a policy fails in one scene and passes in the next; farther out it fails nearly always.
"""

from collections.abc import Iterator, Sequence

from vlafuzz.failures.triage.directions import directed
from vlafuzz.failures.triage.path import Path, free_genes
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import CONFOUNDERS, Space

PLACES = 3  # beyond the scene; the last one is the end of the range


def outward(space: Space, scene: Scene, operators: Sequence[str], reference: Scene | None = None) -> Iterator[Scene]:
    """Scenes beyond a failing one, the nearest first.

    Args:
        operators: that move, the confounders' as one, which stay; all others keep their values. reference: from which
        they move away; None for the nominal scene.
    """
    start = reference or space.nominal(like=scene)
    numeric = [operator for name in operators if name != CONFOUNDERS for operator in space.group(name)]
    path = Path(space, scene, free_genes(space, scene, numeric, start), start)
    steps = {path.length + (path.end - path.length) * place // PLACES for place in range(1, PLACES + 1)}
    directions = directed(space, scene, operators, reference)
    for step in sorted(steps - {path.length}):
        moved = path.at(step)
        if directed(space, moved, operators, reference) == directions:
            yield moved
