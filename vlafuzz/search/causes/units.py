"""Units: what is reset together when a failure is attributed, and how alike two scenes are in it."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.model import Gene
from vlafuzz.search.base import Genome

Levels = NDArray[np.int64]  # (dim,)

CONFOUNDERS = "confounders"
SAME, OTHER, NOMINAL = 0.95, 0.2, 0.03  # chance that a category, another one or the reference's is in a fault
CATEGORY, LEAST = 0.5, 0.15  # severity of a category, and of the smallest number
SLIGHT = 0.02  # deviation of a unit that differs, but not in its first gene
BEYOND = 0.92  # chance that a value farther from the reference than one in a fault is in it, too
FEWER, AS_MANY = 0.1, 0.35  # the same with fewer confounders, and with at least as many
FAR, NEAR = 0.3, 0.45  # and if the nearest is farther, and at least as near


@dataclass(frozen=True)
class Unit:
    """Genes that are reset together: all of the confounders', of the camera's place, else a single one."""

    operator: str
    kind: str
    indices: tuple[int, ...]


class Units:
    """The units of a space, and a reference, by default the nominal scene, to whose values they are reset."""

    def __init__(self, genes: Sequence[Gene], reference: Levels | None = None) -> None:
        nominal = np.array([gene.grid.nominal_level for gene in genes], dtype=np.int64)
        self.genes, self.reference = tuple(genes), nominal if reference is None else reference
        self._sizes = np.array([gene.grid.size for gene in genes])
        members: dict[tuple[str, str, str], list[int]] = {}
        for index, gene in enumerate(genes):
            members.setdefault(_unit(gene), []).append(index)
        self.units = tuple(Unit(operator, kind, tuple(indices)) for (_, operator, kind), indices in members.items())
        self._categories = np.array([unit.kind == "category" for unit in self.units])
        self._members = np.array([index for unit in self.units for index in unit.indices], dtype=np.int64)
        owners = {index: number for number, unit in enumerate(self.units) for index in unit.indices}
        self._owners = np.array([owners[index] for index in range(len(genes))], dtype=np.int64)  # the unit of each gene
        self._begins = np.cumsum([0, *(len(unit.indices) for unit in self.units)])[:-1]  # of each unit among them
        self._wraps = np.array([gene.grid.wraps for gene in genes])
        at = {gene.path: index for index, gene in enumerate(genes)}
        self._count = at.get(CONFOUNDERS)  # None where their number does not vary
        self._around = next((i for i, unit in enumerate(self.units) if unit.kind == CONFOUNDERS), -1)
        self._axes = [
            (at[f"targets.0.{axis}"], [at[path] for path in at if re.fullmatch(rf"confounders\..*\.{axis}", path)])
            for axis in "xy"
            if f"targets.0.{axis}" in at and self._count is not None
        ]
        self._steps = np.array([gene.grid.step for gene in genes])
        self._lows = np.array([gene.grid.value(0) for gene in genes])

    def operators(self, kept: Mask) -> tuple[str, ...]:
        """The operators of some units, each once."""
        return tuple(dict.fromkeys(unit.operator for unit, stays in zip(self.units, kept, strict=True) if stays))

    def taken(self, levels: Levels, operators: Collection[str]) -> Mask:
        """``(units,)`` those of some operators whose values are not the reference's."""
        differs = self.deviations(levels[None])[0, :-1] != 0
        return np.asarray(differs & np.array([unit.operator in operators for unit in self.units]))

    def levels(self, genome: Genome) -> Levels:
        """The levels of a genome."""
        return np.asarray(np.minimum((genome * self._sizes).astype(np.int64), self._sizes - 1))

    def genome(self, levels: Levels) -> Genome:
        """The genome at the middle of levels."""
        return np.asarray((levels + 0.5) / self._sizes)

    def keep(self, levels: Levels, kept: Mask) -> Levels:
        """The levels with all other units reset."""
        reset = np.where(kept[self._owners], levels, self.reference)
        if self._axes and kept[self._around]:
            self._follow(reset, levels)
        return reset

    def _follow(self, reset: Levels, levels: Levels) -> None:
        """Move confounders with the target, as far as there is room: how near they are may matter."""
        moved = {}
        for target, around in self._axes:
            metres = self._steps[target] * (reset[target] - levels[target])
            moved[target] = reset[around] + np.round(metres / self._steps[around]).astype(np.int64)
        fits = [(moved[target] >= 0) & (moved[target] < self._sizes[around]) for target, around in self._axes]
        for target, around in self._axes:
            reset[around] = np.where(np.all(fits, axis=0), moved[target], reset[around])

    def jittered(self, levels: Levels, rng: np.random.Generator) -> Levels:
        """The levels with one number a grid step off, if there is any number."""
        numbers = [index for index, gene in enumerate(self.genes) if gene.kind not in ("category", "count")]
        near = levels.copy()
        if not numbers:
            return near
        index = int(rng.choice(numbers))
        steps = [step for step in (-1, 1) if 0 <= levels[index] + step < self._sizes[index]]
        near[index] += rng.choice(steps or [0])
        return near

    def ends(self, supply: NDArray[np.int64]) -> list[list[Levels]]:
        """For each unit, scenes in which it is as far from the reference as it gets, on either side.

        Args:
            supply: ``(n, dim)`` random scenes, of which it takes categories, confounders and the rest of a place.
        """
        away, scenes = self.deviations(supply), list[list[Levels]]()
        for column, unit in enumerate(self.units):
            index = unit.indices[0]
            start, size, half = self.reference[index], self._sizes[index], self._sizes[index] // 2
            sides = {(start + half - 1) % size, (start - half + 1) % size}
            if not self.genes[index].grid.wraps:
                sides = {0, size - 1}
            if unit.kind == "category":
                scenes.append(list(supply[supply[:, index] != start]))
            elif unit.kind == CONFOUNDERS:
                scenes.append([supply[int(np.argmin(away[:, -1]))]])
            else:
                farthest = supply[int(np.argmax(np.abs(away[:, column])))]
                moved = [np.where(np.arange(len(farthest)) == index, side, farthest) for side in sorted(sides)]
                scenes.append([levels for levels in moved if levels[index] != start])
        return scenes

    def numbers(self, kept: Mask) -> list[int]:
        """The genes of those units that are a number."""
        pairs = zip(self.units, kept, strict=True)
        return [unit.indices[0] for unit, stays in pairs if stays and unit.kind == "number"]

    def severity(self, deviations: Array) -> Array:
        """``(units,)`` chance that values as far from the reference are in a fault; 0 for the reference's."""
        here = np.abs(deviations[:-1])
        number = np.array([unit.kind == "number" for unit in self.units])
        return np.where(here == 0, 0.0, np.where(number, np.minimum(LEAST + here, 1.0), CATEGORY))

    def deviations(self, levels: NDArray[np.int64]) -> Array:
        """``(n, units + 1)`` signed distances from the reference, as shares of the range on that side.

        Of a category 1 + its level, of confounders 1 + their number; 0 for the reference's. The last column is the
        distance of the nearest confounder from the first target, metres; infinite if there is none.
        """
        differs = np.logical_or.reduceat((levels != self.reference)[:, self._members], self._begins, axis=1)
        firsts = self._members[self._begins]
        here, start, size = levels[:, firsts], self.reference[firsts], self._sizes[firsts]
        away = here - start
        around = ((away + size // 2) % size - size // 2) / (size / 2)
        along = away / np.where(away > 0, np.maximum(size - 1 - start, 1), np.maximum(start, 1))
        far = np.where(self._wraps[firsts], around, along)
        far = np.where(self._categories, 1.0 + here, np.where(away == 0, SLIGHT, far))  # as far off, elsewhere
        if self._around >= 0:
            far[:, self._around] = 1.0 + self._number(levels)
        return np.concatenate([np.where(differs, far, 0.0), self._nearest(levels)[:, None]], axis=1)

    def _nearest(self, levels: NDArray[np.int64]) -> Array:
        if len(self._axes) < 2:
            return np.full(len(levels), np.inf)
        at = self._lows + self._steps * levels
        squares = [(at[:, around] - at[:, [target]]) ** 2 for target, around in self._axes]
        distances = np.sqrt(np.sum(squares, axis=0))
        used = np.arange(distances.shape[1]) < self._number(levels)[:, None]
        return np.asarray(np.where(used, distances, np.inf).min(axis=1, initial=np.inf))

    def _number(self, levels: NDArray[np.int64]) -> Array:
        """``(n,)`` of confounders; 0 where it does not vary."""
        if self._count is None:
            return np.zeros(len(levels))
        return np.asarray(self._lows[self._count] + levels[:, self._count])

    def doses(self, operators: Collection[str], others: Array, one: Array) -> Array:
        """``(n,)`` how far ``others`` deviate in the way of ``one``, as a share of how far it does; by deviations."""
        dose = np.full(len(others), np.inf)
        for column, unit in enumerate(self.units):
            x, z = others[:, column], one[column]
            if unit.operator not in operators or not z:
                continue
            if unit.kind == "category":
                share = np.where(x == z, 1.0, np.where(x == 0, 0.0, 0.5))
            elif unit.kind == CONFOUNDERS:
                nearness = np.minimum(one[-1], 9.0) / np.minimum(others[:, -1], 9.0)  # metres; alone, as far as can be
                share = np.where(x > 0, nearness, 0.0)
            else:
                share = x / z
            dose = np.minimum(dose, share)
        return dose

    def alike(self, others: Array, one: Array) -> Array:
        """``(n, units)`` chance that a value is in a fault's range, given that ``one`` is; by deviations."""
        chances = np.empty((len(others), len(self.units)))
        for column, unit in enumerate(self.units):
            x, z = others[:, column], one[column]
            if unit.kind == "category":
                chances[:, column] = np.where(x == z, SAME, np.where(x == 0, NOMINAL, OTHER))
            elif unit.kind == CONFOUNDERS:
                share = np.minimum(one[-1], 1.0) / np.minimum(others[:, -1], 1.0)
                near = np.where(share >= 1, NEAR, FAR * share**3)
                chances[:, column] = np.where(x == 0, NOMINAL, near + np.where(x >= z, AS_MANY, FEWER))
            else:
                share = np.clip(x / z, 0.0, None) if z else np.zeros_like(x)
                chances[:, column] = np.where(share >= 1, BEYOND, np.clip(share**2, 0.02, None))
        return chances


def _unit(gene: Gene) -> tuple[str, str, str]:
    """The name, operator and kind of the unit that a gene is part of."""
    if gene.operator.startswith("confounder-"):
        return CONFOUNDERS, CONFOUNDERS, CONFOUNDERS
    name = gene.operator if gene.operator == "camera-position" else gene.path
    return name, gene.operator, "category" if gene.kind == "category" else "number"
