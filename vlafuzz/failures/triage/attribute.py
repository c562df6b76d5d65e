"""Attribute: which operators a failure needs, and from which values on it does; by intervention."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.oracle import Oracle
from vlafuzz.failures.triage.path import Path, direction, free_genes, steps
from vlafuzz.failures.triage.thresholds import Seen, locate
from vlafuzz.model import Causes, Gene, Scene, Space, Threshold
from vlafuzz.model.evidence import Values
from vlafuzz.model.space import CONFOUNDERS


def attribute(
    shrunk: Shrunk, oracle: Oracle, space: Space, trials: Sequence[tuple[Scene, bool]] = (), *, located: bool = False
) -> Causes:
    """The causes of a shrunk failure, from the oracle that it was shrunk with.

    Args:
        trials: scenes of the run, and whether each failed.
        located: the thresholds of this cause are known, and left out here.
    """
    left = shrunk.operators
    numeric = [name for name in left if name != CONFOUNDERS] if shrunk.minimal and not located else []
    thresholds = [_threshold(shrunk, name, oracle, space, trials) for name in numeric]
    return Causes(
        tuple(shrunk.counterparts),
        left if len(left) == 1 else (),  # of several that are all necessary none is enough
        tuple(filter(None, thresholds)),
    )


def _threshold(
    shrunk: Shrunk, name: str, oracle: Oracle, space: Space, trials: Sequence[tuple[Scene, bool]]
) -> Threshold | None:
    scene, start = shrunk.scene, shrunk.reference or space.nominal(like=shrunk.scene)
    genes = [gene for gene in free_genes(space, scene, space.group(name), start) if gene.kind != "category"]
    path = Path(space, scene, genes, start)
    first = shrunk.rates.get(name) if path.at(0) == shrunk.counterparts.get(name) else None
    located = locate(path, oracle, first, shrunk.rate, _seen(shrunk, genes, start, space, trials))
    if located is None:
        return None

    def values(step: int | None) -> Values:
        at = {} if step is None else space.values(path.at(step))
        return tuple((gene.path, at[gene.path]) for gene in genes if at)

    return Threshold(
        name,
        values(located.crossing),
        located.crossing / path.length,
        low=values(located.low),
        high=values(located.high),
        direction=direction(space, scene, name, start),
        ranges=((values(located.crossing), values(located.until)),),
    )


def _seen(
    shrunk: Shrunk, genes: Sequence[Gene], start: Scene, space: Space, trials: Sequence[tuple[Scene, bool]]
) -> Seen:
    """The outcomes of a run that tell where a single number starts to make the policy fail."""
    if len(genes) != 1 or CONFOUNDERS in shrunk.operators:  # scenes with fewer confounders lack values
        return Seen()
    others = [one for name in shrunk.operators if name != genes[0].operator for one in space.group(name)]
    taken = free_genes(space, shrunk.scene, others, start)
    if not {gene.kind for gene in (*genes, *taken)} <= {"real", "angle"}:
        return Seen()
    usual = space.values(start)

    def away(scene: Scene) -> NDArray[np.float64]:
        values = space.values(scene)
        return np.array([steps(gene, usual[gene.path], values[gene.path]) for gene in (*genes, *taken)], dtype=float)

    whole, outcomes, elsewhere = away(shrunk.scene), list[tuple[float, bool]](), list[bool]()
    for scene, failed in trials:
        along, *beside = away(scene) / whole
        if along <= 0:
            elsewhere.append(failed)
        elif min(beside, default=1.0) >= 1:
            outcomes.append((along * abs(whole[0]), failed))
    return Seen(outcomes, (sum(elsewhere) + 1) / (len(elsewhere) + 2))
