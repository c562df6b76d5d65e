"""Known causes: a failure with the operators of a certified cause needs no search of its own."""

from collections.abc import Iterable, Sequence

from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.store.records import Triaged
from vlafuzz.triage.certify import Shrunk, certify_one
from vlafuzz.triage.directions import directed
from vlafuzz.triage.oracle import Oracle
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, deviating
from vlafuzz.triage.reference import Reference
from vlafuzz.triage.shrink import drop_confounders


def certified(triaged: Iterable[Triaged | None]) -> list[Triaged]:
    """The first minimal finding of every signature."""
    first: dict[str, Triaged] = {}
    for result in triaged:
        if result and result.bucket == "minimal" and result.signature:
            first.setdefault(result.signature, result)
    return list(first.values())


def by_known_cause(
    scene: Scene, known: Sequence[Triaged], oracle: Oracle, space: SearchSpace, reference: Reference
) -> Shrunk | None:
    """The evidence that a failing scene has a known cause.

    That is the scene with the operators of that cause alone, as far from the reference as they were found: it
    mostly fails, and without any one of them it mostly passes, by rollouts of its own.

    Args:
        known: certified findings.

    Returns:
        None where no known cause deviates in the same direction, or its operators do not explain the failure.
    """
    tried = list(dict.fromkeys(filter(None, (_alike(scene, one, space, reference) for one in known))))
    failing = [one for one, fails in zip(tried, oracle.fails(tried), strict=True) if fails]
    if not failing:
        return None
    simplest = min(failing, key=lambda one: len(deviating(space, one, reference.scene)))
    simplest = drop_confounders(simplest, oracle, space, reference.scene)
    shrunk = certify_one(simplest, oracle, space, reference)
    return shrunk if shrunk.minimal else None


def _alike(scene: Scene, known: Triaged, space: SearchSpace, reference: Reference) -> Scene | None:
    """The scene with the operators of a known cause alone; None where they are not off in its directions."""
    others = [each for name, several in GROUPS.items() if name not in known.operators for each in several]
    alone = space.reset(scene, others, reference.scene)
    assert known.shrunk is not None
    same = _directions(space, alone, reference.scene) == _directions(space, known.shrunk, known.reference)
    return alone if same else None


def _directions(space: SearchSpace, scene: Scene, reference: Scene | None) -> list[str]:
    """Operators with their directions; what confounders are matters only for whether there are any."""
    left = deviating(space, scene, reference)
    others = [name for name in left if name != CONFOUNDERS]
    return directed(space, scene, others, reference) + [CONFOUNDERS] * (CONFOUNDERS in left)
