"""MCTS: a tree decides which operators to perturb and how far; failing branches are visited more."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vlafuzz.model.genes import Gene
from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import OneByOne
from vlafuzz.search.scoring import Score

EXTENTS = ("nominal", "near", "far")  # an operator's perturbation: none, up to half of its range, more
CURIOSITY = 0.7  # weight of exploration in UCB1
MOST_NODES = 20_000  # the tree stops growing there

Rng = np.random.Generator


class Node:
    """Visits and failures of the scenes whose first operators have the same extents."""

    def __init__(self) -> None:
        self.children: dict[int, Node] = {}
        self.visits, self.failures = 0, 0.0

    def promise(self, extent: int) -> float:
        """Upper confidence bound of a child's failure rate (UCB1); infinite for an unvisited child."""
        child = self.children.get(extent)
        if child is None or child.visits == 0:
            return math.inf
        return child.failures / child.visits + CURIOSITY * math.sqrt(math.log(self.visits) / child.visits)


class Mcts(OneByOne):
    """Monte Carlo tree search as in RoboTest, but rewarded for failures. A baseline.

    UCT: Kocsis, Szepesvári 2006 <https://doi.org/10.1007/11871842_29>. RoboTest <https://github.com/scuama/RoboTest>
    rewards successes. The n-th level of the tree decides how far the n-th operator is from nominal. A pending scene
    counts as a pass, so that a batch spreads over the tree.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._root, self._nodes = Node(), 1
        self._operators = list(dict.fromkeys(gene.operator for gene in space.genes))
        self._out: dict[int, list[Node]] = {}

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Reward the branches of failures; undo the visits of invalid scenes."""
        for proposal, score in zip(proposals, scores, strict=True):
            for node in self._out.pop(proposal.id):
                node.failures += score.failed
                node.visits -= not score.rolled_out

    def _genome(self, number: int, rng: Rng) -> Genome:
        extents, path = self._descend(rng)
        self._out[number] = path
        for node in path:
            node.visits += 1
        return self._proposals.first_new(lambda: self._drawn(extents, rng), rng)

    def _descend(self, rng: Rng) -> tuple[dict[str, int], list[Node]]:
        """An extent for each operator, and the nodes visited; at most one of them is new."""
        node: Node | None = self._root
        path, extents = [self._root], dict[str, int]()
        for operator in self._operators:
            if node is None:  # below a new node, or where the tree may not grow
                extents[operator] = int(rng.integers(len(EXTENTS)))
                continue
            promises = [node.promise(extent) for extent in range(len(EXTENTS))]
            best = [extent for extent, promise in enumerate(promises) if promise == max(promises)]
            extent = extents[operator] = best[rng.integers(len(best))]
            known = node.children.get(extent)
            if known is not None:
                path.append(known)
            elif self._nodes < MOST_NODES:
                path.append(node.children.setdefault(extent, Node()))
                self._nodes += 1
            node = known
        return extents, path

    def _drawn(self, extents: dict[str, int], rng: Rng) -> Genome:
        """A random scene with every operator as far from nominal as its extent says."""
        genome = self._space.encode(self._space.sample(rng))
        pairs = zip(self._space.genes, genome, strict=True)
        return np.array([_perturbed(gene, where, EXTENTS[extents[gene.operator]]) for gene, where in pairs])


def _perturbed(gene: Gene, where: float, extent: str) -> float:
    """A gene's coordinate, moved along its range; categories and neutral genes are nominal or as drawn."""
    grid = gene.grid
    level, nominal = min(int(where * grid.size), grid.size - 1), grid.nominal_level
    if extent == "nominal" and not gene.neutral:
        level = nominal
    elif gene.kind != "category" and not gene.neutral and level != nominal:
        farthest = grid.size - 1 - nominal if level > nominal else -nominal
        share = (level - nominal) / farthest / 2 + (0.5 if extent == "far" else 0.0)
        level = nominal + round(share * farthest)
    return (level + 0.5) / grid.size
