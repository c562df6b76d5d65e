"""Attribute: which operators a failure needs, which suffice alone, and their thresholds; by intervention."""

from vlafuzz.evidence import Causes, Threshold
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.triage.oracle import BudgetedOracle
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, PathToNominal, free_genes
from vlafuzz.triage.shrink import BEYOND, Shrunk

SHARES = 32  # steps of a path along which several values move together


def attribute(shrunk: Shrunk, oracle: BudgetedOracle, space: SearchSpace) -> Causes:
    """The causes of a shrunk failure, from the oracle that it was shrunk with."""
    left = shrunk.operators
    alone = {name: _alone(space, shrunk.scene, name) for name in left}
    failing = oracle.fails(list(alone.values()))
    thresholds = [_threshold(shrunk.scene, name, oracle, space) for name in left if name != CONFOUNDERS]
    return Causes(
        tuple(shrunk.counterparts),
        tuple(name for name, fails in zip(alone, failing, strict=True) if fails),
        tuple(filter(None, thresholds)),
    )


def _alone(space: SearchSpace, scene: Scene, name: str) -> Scene:
    others = [operator for group, operators in GROUPS.items() if group != name for operator in operators]
    return space.reset(scene, others)


def _threshold(scene: Scene, name: str, oracle: BudgetedOracle, space: SearchSpace) -> Threshold | None:
    genes = [gene for gene in free_genes(space, scene, GROUPS[name]) if gene.kind != "category"]
    path = PathToNominal(space, scene, genes)
    first = _first_failing(path, oracle, parts=path.length if len(genes) == 1 else SHARES)
    if first is None:
        return None
    values = space.values(path.at(first))
    return Threshold(name, tuple((gene.path, values[gene.path]) for gene in genes), first / path.length)


def _first_failing(path: PathToNominal, oracle: BudgetedOracle, parts: int) -> int | None:
    """The least step that fails, by bisection; None unless the step before it is seen to pass."""
    if path.length == 0:
        return None
    parts = min(parts, path.length)
    passes, fails = 0, parts

    def step(part: int) -> int:
        return round(part * path.length / parts)

    if oracle.fails([path.at(0)])[0]:
        return None
    guesses = [fails - BEYOND, fails - BEYOND - 1]  # where shrinking left it, and one step less
    while fails - passes > 1:
        middle = guesses.pop(0) if guesses else (passes + fails) // 2
        if not passes < middle < fails:
            continue
        if oracle.room == 0 and oracle.known(path.at(step(middle))) is None:
            return None
        if oracle.fails([path.at(step(middle))])[0]:
            fails = middle
        else:
            passes = middle
    before = oracle.known(path.at(step(passes)))
    return step(fails) if before is not None and before.verdict is Verdict.PASSED else None
