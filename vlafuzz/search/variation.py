"""Variation: mutation and crossover on the grid; angles wrap, and confounders come and go as a whole."""

from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model import Gene
from vlafuzz.search.base import Genome

Levels = NDArray[np.int64]  # (dim,)

COUNT, AROUND = "confounders", "confounders."
FINEST, COARSEST = 0.01, 0.5  # standard deviation of a mutation, as a share of the range; log-uniform


class Variation:
    """Mutation and crossover of the genomes of a space.

    A *unit* is the set of genes of one operator in one slot, such as x and y of the first target.
    """

    def __init__(self, genes: Sequence[Gene]) -> None:
        self._genes = tuple(genes)
        self._sizes = np.array([gene.grid.size for gene in genes], dtype=np.int64)
        self._count = next((index for index, gene in enumerate(genes) if gene.path == COUNT), None)
        slots = _grouped(gene.slot for gene in genes)
        self._around = [indices for slot, indices in slots.items() if slot.startswith(AROUND)]
        self._units: dict[str, list[Levels]] = {}
        for (operator, _), indices in _grouped((gene.operator, gene.slot) for gene in genes).items():
            self._units.setdefault(operator, []).append(indices)
        self._of_confounders = {gene.operator for gene in genes if gene.slot.startswith(AROUND)}

    def operators(self, genome: Genome) -> list[str]:
        """The operators that affect the scene: those of confounders only if there are any."""
        bare = self._number(self._levels(genome)) == 0
        return [name for name in self._units if not (bare and name in self._of_confounders)]

    def mutate(self, genome: Genome, operators: Collection[str], rng: np.random.Generator) -> Genome:
        """The genome with some genes of one unit of each of these operators changed."""
        levels = self._levels(genome)
        for name in operators:
            units = self._units[name]
            if name in self._of_confounders:
                units = units[: max(self._number(levels), 1)]
            unit = units[rng.integers(len(units))]
            chosen = rng.random(len(unit)) < 0.5
            chosen[rng.integers(len(unit))] = True
            for index in unit[chosen]:
                self._change(levels, int(index), rng)
        return self._genome(levels)

    def cross(self, mother: Genome, father: Genome, rng: np.random.Generator) -> Genome:
        """A child with each unit taken from either parent, and confounders from both."""
        first, second = self._levels(mother), self._levels(father)
        child = first.copy()
        for name, units in self._units.items():
            for unit in () if name in self._of_confounders else units:
                if rng.random() < 0.5:
                    child[unit] = second[unit]
        return self._genome(self._gathered(child, first, second, rng))

    def splice(self, genome: Genome, donor: Genome, rng: np.random.Generator) -> Genome:
        """The genome with some confounders replaced by the donor's."""
        levels = self._levels(genome)
        return self._genome(self._gathered(levels.copy(), levels, self._levels(donor), rng))

    def _gathered(self, child: Levels, mother: Levels, father: Levels, rng: np.random.Generator) -> Levels:
        """The child with as many confounders as one of the parents, each taken whole from either."""
        count = self._number((mother, father)[rng.integers(2)])
        for number, slot in enumerate(self._around[:count]):
            having = [parent for parent in (mother, father) if self._number(parent) > number]
            child[slot] = having[rng.integers(len(having))][slot]
        if self._count is not None:
            child[self._count] = self._genes[self._count].grid.snap(count)
        return child

    def _change(self, levels: Levels, index: int, rng: np.random.Generator) -> None:
        gene, size = self._genes[index], int(self._sizes[index])
        if size == 1:
            return
        if index == self._count:
            self._add_or_remove(levels, rng)
        elif gene.kind == "category":
            levels[index] = (levels[index] + rng.integers(1, size)) % size
        else:
            spread = FINEST * (COARSEST / FINEST) ** rng.random()
            step = round(rng.normal(0.0, spread * size)) or (1 if rng.random() < 0.5 else -1)
            moved = int(levels[index]) + step
            levels[index] = moved % size if gene.grid.wraps else _reflected(moved, size)

    def _add_or_remove(self, levels: Levels, rng: np.random.Generator) -> None:
        """Add a random confounder or remove one; the others stay as they are."""
        assert self._count is not None
        level, last = int(levels[self._count]), int(self._sizes[self._count]) - 1
        more = level == 0 or (level < last and rng.random() < 0.5)
        number = self._number(levels)
        levels[self._count] = level + (1 if more else -1)
        if more and number < len(self._around):
            slot = self._around[number]
            levels[slot] = [self._genes[index].grid.snap(self._genes[index].draw(rng)) for index in slot]
        elif not more:
            for here in range(int(rng.integers(number)), min(number, len(self._around)) - 1):
                levels[self._around[here]] = levels[self._around[here + 1]]

    def _number(self, levels: Levels) -> int:
        """The number of confounders; if it does not vary, all slots count as used."""
        if self._count is None:
            return len(self._around)
        return int(self._genes[self._count].grid.value(int(levels[self._count])))

    def _levels(self, genome: Genome) -> Levels:
        return np.minimum((genome * self._sizes).astype(np.int64), self._sizes - 1)

    def _genome(self, levels: Levels) -> Genome:
        return np.asarray((levels + 0.5) / self._sizes)


def _grouped(keys: Iterable[Hashable]) -> dict[Any, Levels]:
    """The indices of each key, in order of first occurrence."""
    groups: dict[Hashable, list[int]] = {}
    for index, key in enumerate(keys):
        groups.setdefault(key, []).append(index)
    return {key: np.array(indices, dtype=np.int64) for key, indices in groups.items()}


def _reflected(level: int, size: int) -> int:
    """A level beyond an end of the range is reflected at it."""
    level %= 2 * (size - 1)
    return level if level < size else 2 * (size - 1) - level
