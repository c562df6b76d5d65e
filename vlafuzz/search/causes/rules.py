"""Rules: causes that are known, and which scenes they explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.search.causes.units import CONFOUNDERS, Levels, Numbers, Units

Mask = NDArray[np.bool_]


@dataclass(eq=False)
class Rule:
    """A cause: the units that it takes, and the nearest values to the reference that are known to fail.

    Attributes:
        levels: of its smallest failing scene.
        inner: ``(units,)`` deviations nearest to the reference that fail; ``outer``: farthest.
        values: of categories, those that fail.
        safe: ``(units,)`` deviations that are known to pass while the others fail, 0 where none is.
    """

    kept: Mask
    levels: Levels
    inner: Numbers
    outer: Numbers
    values: dict[int, set[float]]
    safe: Numbers
    hits: int = 1

    @classmethod
    def of(cls, kept: Mask, levels: Levels, deviations: Numbers, units: Units) -> Rule:
        """The rule of a minimal failing scene."""
        values = {
            index: {float(deviations[index])}
            for index in np.flatnonzero(kept).tolist()
            if units.units[index].kind == "category"
        }
        safe = np.zeros(len(kept))
        return cls(kept, levels, deviations.copy(), deviations.copy(), values, safe)

    def chance(self, deviations: Numbers, units: Units) -> Numbers:
        """``(n,)`` chance that scenes are in the fault."""
        chance = np.ones(len(deviations))
        for index in np.flatnonzero(self.kept).tolist():
            x, unit = deviations[:, index], units.units[index]
            if unit.kind == "category":
                chance *= np.where(np.isin(x, list(self.values[index])), 1.0, np.where(x == 0, 0.0, 0.4))
            elif unit.kind == CONFOUNDERS:
                near = deviations[:, -1] <= self.inner[-1] + 1e-9
                many = x >= self.inner[index]
                chance *= np.where(x == 0, 0.0, np.where(near & many, 0.75, np.where(near | many, 0.4, 0.15)))
            else:
                inner, safe = abs(self.inner[index]), abs(self.safe[index])
                along = x * np.sign(self.inner[index])
                rising = np.clip((along - safe) / max(inner - safe, 1e-9), 0.0, 1.0)
                chance *= np.where(along >= inner, 0.98, rising)
        return chance

    def same_kind(self, other: Rule) -> bool:
        """Whether it takes the same units, deviating in the same directions."""
        if (self.kept != other.kept).any():
            return False
        numbers = [index for index in np.flatnonzero(self.kept).tolist() if index not in self.values]
        return bool((np.sign(self.inner[numbers]) == np.sign(other.inner[numbers])).all())

    def learn_failure(self, deviations: Numbers, levels: Levels, units: Units) -> None:
        """A scene with its units alone fails: its range reaches as far."""
        self.hits += 1
        nearer = True
        for index in np.flatnonzero(self.kept).tolist():
            if index in self.values:
                self.values[index].add(float(deviations[index]))
                nearer &= deviations[index] == self.inner[index]
            else:
                nearer &= bool(abs(deviations[index]) <= abs(self.inner[index]))
                if abs(deviations[index]) < abs(self.inner[index]):
                    self.inner[index] = deviations[index]
                if abs(self.inner[index]) < abs(self.safe[index]):
                    self.safe[index] = 0.0
        self.inner[-1] = max(self.inner[-1], deviations[-1])
        if nearer:
            self.levels = levels

    def learn_pass(self, deviations: Numbers) -> None:
        """A scene with its units alone passes: if one of them is nearer to the reference, that is why."""
        nearer = [
            index
            for index in np.flatnonzero(self.kept).tolist()
            if index not in self.values and abs(deviations[index]) < abs(self.inner[index]) - 1e-9
        ]
        if len(nearer) == 1 and abs(deviations[nearer[0]]) > abs(self.safe[nearer[0]]):
            self.safe[nearer[0]] = deviations[nearer[0]]
