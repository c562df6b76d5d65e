"""Attribute: which operators a failure takes, which alone are enough, and from where on. By intervention."""

from __future__ import annotations

from vlafuzz.evidence import Causes, Threshold
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.triage.oracle import BudgetedOracle
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, PathToNominal, free_genes
from vlafuzz.triage.shrink import BEYOND, Shrunk

SHARES = 32  # steps of a way that several values go together


def attribute(shrunk: Shrunk, oracle: BudgetedOracle, space: SearchSpace) -> Causes:
    """Causes of what is left of a finding, with the bench that it was shrunk on."""
    left = shrunk.operators
    alone = {name: _alone(space, shrunk.scene, name) for name in left}
    failing = oracle.fails(list(alone.values()))
    thresholds = [_threshold(shrunk.scene, name, oracle, space) for name in left if name != CONFOUNDERS]
    return Causes(
        tuple(shrunk.counterparts),
        tuple(name for name, fails in zip(alone, failing, strict=True) if fails),
        tuple(found for found in thresholds if found),
    )


def _alone(space: SearchSpace, scene: Scene, name: str) -> Scene:
    others = [one for group, operators in GROUPS.items() if group != name for one in operators]
    return space.reset(scene, others)


def _threshold(scene: Scene, name: str, oracle: BudgetedOracle, space: SearchSpace) -> Threshold | None:
    genes = [gene for gene in free_genes(space, scene, GROUPS[name]) if gene.kind != "category"]
    way = PathToNominal(space, scene, genes)
    first = _first_failing(way, oracle, parts=way.length if len(genes) == 1 else SHARES)
    if first is None:
        return None
    values = space.values(way.at(first))
    return Threshold(name, tuple((gene.path, values[gene.path]) for gene in genes), first / way.length)


def _first_failing(way: PathToNominal, oracle: BudgetedOracle, parts: int) -> int | None:
    """By bisection, the least step that fails; None where it is not seen to pass one step before."""
    if way.length == 0:
        return None
    parts = min(parts, way.length)
    passes, fails = 0, parts

    def step(part: int) -> int:
        return round(part * way.length / parts)

    if oracle.fails([way.at(0)])[0]:
        return None
    guesses = [fails - BEYOND, fails - BEYOND - 1]  # where shrinking left it, and one step less
    while fails - passes > 1:
        middle = guesses.pop(0) if guesses else (passes + fails) // 2
        if not passes < middle < fails:
            continue
        if oracle.room == 0 and oracle.known(way.at(step(middle))) is None:
            return None
        if oracle.fails([way.at(step(middle))])[0]:
            fails = middle
        else:
            passes = middle
    before = oracle.known(way.at(step(passes)))
    return step(fails) if before is not None and before.verdict is Verdict.PASSED else None
