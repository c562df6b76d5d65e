"""Attribute: which operators a failure needs, which suffice alone, and their thresholds; by intervention."""

from vlafuzz.evidence import Causes, Threshold
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.triage.certify import Shrunk
from vlafuzz.triage.oracle import Answer, Oracle
from vlafuzz.triage.path import CONFOUNDERS, GROUPS, Path, free_genes
from vlafuzz.triage.shrink import BEYOND

SHARES = 32  # steps of a path along which several values move together


def attribute(shrunk: Shrunk, oracle: Oracle, space: SearchSpace) -> Causes:
    """The causes of a shrunk failure, from the oracle that it was shrunk with."""
    left = shrunk.operators
    alone = {name: _alone(space, shrunk, name) for name in left}
    failing = oracle.fails(list(alone.values()))
    thresholds = [_threshold(shrunk, name, oracle, space) for name in left if name != CONFOUNDERS]
    return Causes(
        tuple(shrunk.counterparts),
        tuple(name for name, fails in zip(alone, failing, strict=True) if fails),
        tuple(filter(None, thresholds)),
    )


def _alone(space: SearchSpace, shrunk: Shrunk, name: str) -> Scene:
    others = [operator for group, operators in GROUPS.items() if group != name for operator in operators]
    return space.reset(shrunk.scene, others, shrunk.reference)


def _threshold(shrunk: Shrunk, name: str, oracle: Oracle, space: SearchSpace) -> Threshold | None:
    genes = [
        gene
        for gene in free_genes(space, shrunk.scene, GROUPS[name], shrunk.reference)
        if gene.kind != "category"
    ]
    path = Path(space, shrunk.scene, genes, shrunk.reference)
    first = _first_failing(path, oracle, parts=path.length if len(genes) == 1 else SHARES)
    if first is None:
        return None
    values = space.values(path.at(first))
    return Threshold(name, tuple((gene.path, values[gene.path]) for gene in genes), first / path.length)


def _first_failing(path: Path, oracle: Oracle, parts: int) -> int | None:
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
    return step(fails) if before is Answer.PASSES else None
