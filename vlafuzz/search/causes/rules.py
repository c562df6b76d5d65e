"""Rules: the causes that are known, and which scenes they explain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.search.causes.units import CONFOUNDERS, Levels, Units

ONE_HALF = 0.5
KNOWN = 0.85  # chance from which a rule explains a failure


@dataclass(eq=False)
class Rule:
    """A cause: the units that it takes, and the nearest values to the reference that are known to fail.

    Attributes:
        kept: ``(units,)`` those that it takes.
        levels: of its smallest failing scene.
        inner: ``(units + 1,)`` deviations nearest to the reference that fail.
        values: of categories, those that fail.
        safe: ``(units,)`` the farthest deviations that pass while the others fail, 0 where none is known. tests: see
        ``Cause``; hits: failures that it explains.
    """

    kept: Mask
    levels: Levels
    inner: Array
    values: dict[int, set[float]]
    safe: Array
    tests: Mapping[str, tuple[bool, ...]]
    hits: int = 1

    @classmethod
    def of(
        cls, kept: Mask, levels: Levels, deviations: Array, units: Units, tests: Mapping[str, tuple[bool, ...]]
    ) -> Rule:
        """The rule of a minimal failing scene."""
        values = {
            index: {float(deviations[index])}
            for index in np.flatnonzero(kept).tolist()
            if units.units[index].kind == "category"
        }
        safe = np.zeros(len(kept))
        return cls(kept, levels, deviations.copy(), values, safe, tests)

    def chance(self, deviations: Array, units: Units) -> Array:
        """``(n,)`` chance that scenes are in the fault."""
        return np.asarray(self._chances(deviations, units).prod(axis=0))

    def region(self, deviations: Array, units: Units) -> Mask:
        """``(n,)`` whether scenes are in its range: each value by itself is more likely in the fault than not."""
        return np.asarray((self._chances(deviations, units) >= ONE_HALF).all(axis=0))

    def _chances(self, deviations: Array, units: Units) -> Array:
        """``(kept, n)`` chance that the value of each unit is in the fault."""
        chances = []
        for index in np.flatnonzero(self.kept).tolist():
            x, unit = deviations[:, index], units.units[index]
            if unit.kind == "category":
                chances.append(np.where(np.isin(x, list(self.values[index])), 1.0, np.where(x == 0, 0.0, 0.4)))
            elif unit.kind == CONFOUNDERS:
                near = deviations[:, -1] <= self.inner[-1] + 1e-9
                many = x >= self.inner[index]
                likely = np.where(near & many, 0.75, np.where(near | many, 0.4, 0.15))
                chances.append(np.where(x == 0, 0.0, likely))
            else:
                inner, safe = abs(self.inner[index]), abs(self.safe[index])
                along = x * np.sign(self.inner[index])
                rising = np.clip((along - safe) / max(inner - safe, 1e-9), 0.0, 1.0)
                chances.append(np.where(along >= inner, 0.98, rising))
        return np.array(chances)

    def halfway(self, units: Units) -> Iterator[Levels]:
        """Its scene with one of its numbers halfway back to the reference, where its range is probed."""
        for unit in units.numbers(self.kept):
            levels = self.levels.copy()
            levels[unit] -= round(int(levels[unit] - units.reference[unit]) / 2)
            if levels[unit] != self.levels[unit]:
                yield levels

    def same_kind(self, other: Rule) -> bool:
        """Whether it takes the same units, deviating in the same directions."""
        if (self.kept != other.kept).any():
            return False
        numbers = [index for index in np.flatnonzero(self.kept).tolist() if index not in self.values]
        return bool((np.sign(self.inner[numbers]) == np.sign(other.inner[numbers])).all())

    def needs_all_of(self, other: Rule) -> bool:
        """Whether it takes all units of another rule, and more."""
        return bool((self.kept >= other.kept).all() and (self.kept > other.kept).any())

    def learn_failure(self, deviations: Array, shown: Rule | None = None) -> None:
        """A scene with its units alone fails: its range reaches as far.

        Args:
            shown: its rule, if it was repeated: a scene that may have failed by chance cannot stand for a cause.
        """
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
        if nearer and shown is not None:
            self.levels, self.tests = shown.levels, shown.tests

    def learn_pass(self, deviations: Array) -> None:
        """A scene with its units alone passes: if one of them is nearer to the reference, that is why."""
        nearer = [
            index
            for index in np.flatnonzero(self.kept).tolist()
            if index not in self.values and abs(deviations[index]) < abs(self.inner[index]) - 1e-9
        ]
        if len(nearer) == 1 and abs(deviations[nearer[0]]) > abs(self.safe[nearer[0]]):
            self.safe[nearer[0]] = deviations[nearer[0]]


class Rules(list[Rule]):
    """All rules so far, in the order in which they were found."""

    def explain(self, deviations: Array, units: Units) -> Array:
        """``(n,)`` chance that scenes fail for a known reason."""
        left = np.ones(len(deviations))
        for rule in self:
            left *= 1 - rule.chance(deviations, units)
        return np.asarray(1 - left)

    def regions(self, deviations: Array, units: Units) -> Mask:
        """``(n, rules)`` whether scenes are in the range of each."""
        inside = [rule.region(deviations, units) for rule in self]
        return np.stack(inside, axis=1) if inside else np.zeros((len(deviations), 0), dtype=bool)

    def likeliest(self, deviations: Array, units: Units) -> tuple[Rule | None, float]:
        """The rule that most likely explains one scene, and the chance that it does."""
        chances = [float(rule.chance(deviations[None], units)[0]) for rule in self]
        if not chances:
            return None, 0.0
        best = int(np.argmax(chances))
        return self[best], chances[best]

    def add(self, rule: Rule, deviations: Array, units: Units) -> Rule:
        """Add a rule; one of the same kind is widened instead. Returns the rule that is in the list.

        Rules whose scene it explains with fewer units go: chance has kept a unit too many in them.
        """
        for other in self:
            if other.same_kind(rule):
                other.learn_failure(deviations, rule)
                return other
        for other in [other for other in self if other.needs_all_of(rule)]:
            scene = units.deviations(other.levels[None])
            if rule.chance(scene, units)[0] >= KNOWN:
                rule.hits += other.hits
                self.remove(other)
        self.append(rule)
        return rule
