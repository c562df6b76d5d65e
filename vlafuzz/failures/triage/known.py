"""Known causes: a failure with the values of a certified cause needs no search of its own."""

from collections.abc import Iterable, Sequence

from vlafuzz.failures.triage.certify import Shrunk, certify_one
from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.path import deviating, directed, free_genes
from vlafuzz.failures.triage.reference import Reference
from vlafuzz.failures.triage.shrink import drop_confounders
from vlafuzz.model import Scene, Space
from vlafuzz.model.space import CONFOUNDERS
from vlafuzz.store.records import Triaged


def certified(triaged: Iterable[Triaged | None]) -> list[Triaged]:
    """The first minimal finding of every signature."""
    first: dict[str, Triaged] = {}
    for result in triaged:
        if result and result.bucket == "minimal" and result.signature:
            first.setdefault(result.signature, result)
    return list(first.values())


def by_known_cause(
    scene: Scene, known: Sequence[Triaged], oracle: Oracle, space: Space, reference: Reference
) -> Shrunk | None:
    """The evidence that a failing scene has a known cause.

    That is the scene with the values alone that the cause is about, as far from the reference as they were found: it
    fails more often than without any one of the operators, by rollouts of its own.

    Args:
        known: certified findings.

    Returns:
        None where the scene deviates as no known cause does, or that does not explain the failure.
    """
    alike = (_alike(scene, one, space, reference) for one in known if space.subject not in one.operators)
    tried = list(dict.fromkeys(filter(None, alike)))
    failing = [one for one, fails in zip(tried, oracle.fails(tried), strict=True) if fails]
    if not failing:
        return None
    simplest = min(failing, key=lambda one: len(deviating(space, one, reference.scene)))
    simplest = drop_confounders(simplest, oracle, space, reference.scene)
    shrunk = certify_one(simplest, oracle, space, reference)
    return shrunk if shrunk.minimal else None


def _alike(scene: Scene, known: Triaged, space: Space, reference: Reference) -> Scene | None:
    """The scene with the values of a known cause alone; None where they are not off in its directions."""
    assert known.shrunk is not None
    # The paths of the values that the cause is about: of a displacement and of confounders all.
    operators = [each for name in known.operators for each in space.group(name)]
    whole = {gene.operator for gene in space.genes if gene.neutral} | set(space.groups.get(CONFOUNDERS, ()))
    kept = {gene.path for gene in free_genes(space, known.shrunk, operators, known.reference)}
    kept |= {gene.path for gene in space.genes if gene.operator in whole.intersection(operators)}
    start = space.nominal_values if reference.scene is None else space.values(reference.scene)
    others = {
        gene.path: start[gene.path] for gene in space.genes if gene.path not in kept and gene.operator != space.subject
    }
    alone = space.compose(space.values(scene) | others)
    same = _directions(space, alone, reference.scene) == _directions(space, known.shrunk, known.reference)
    return alone if same else None


def _directions(space: Space, scene: Scene, reference: Scene | None) -> list[str]:
    """Operators with their directions; what confounders are matters only for whether there are any."""
    left = deviating(space, scene, reference)
    others = [name for name in left if name != CONFOUNDERS]
    return directed(space, scene, others, reference) + [CONFOUNDERS] * (CONFOUNDERS in left)
