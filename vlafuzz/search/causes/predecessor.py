"""Predecessor: an earlier run of another version of the policy, or of another task, as a hint that is always tested."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.search.base import Genome
from vlafuzz.search.causes.units import Levels, Units

TREES, LEAF = 100, 3  # of a forest, and least scenes in a leaf
AGAIN, OWN = 25, 2.0  # outcomes of the run after which trees are grown anew, and their weight
KINDS = 5  # of scenes, by how likely they fail: told apart more finely, each has few draws


@dataclass(frozen=True, eq=False)
class Predecessor:
    """What an earlier run found, as genomes of the new run's space.

    Attributes:
        causes: the scene and the operators of each, in the order in which they are to be tested.
        genomes: ``(n, dim)`` the scenes in which it rolled out.
        failed: ``(n,)`` whether it failed there.
    """

    causes: tuple[tuple[Genome, tuple[str, ...]], ...]
    genomes: NDArray[np.float64]
    failed: NDArray[np.bool_]

    def suspects(self, units: Units) -> list[tuple[Levels, NDArray[np.bool_]]]:
        """The scene of each cause, and the units that it takes there."""
        found = list[tuple[Levels, NDArray[np.bool_]]]()
        for genome, operators in self.causes:
            levels = units.levels(genome)
            taken = np.array([unit.operator in operators for unit in units.units])
            found.append((levels, taken & (units.deviations(levels[None])[0, :-1] != 0)))
        return [(levels, taken) for levels, taken in found if taken.any()]


class Forecast:
    """Sorts scenes by how likely they are to fail, as far as the outcomes of a predecessor and of the run so far tell.

    It decides no outcome: a good one makes the interval of the failure probability narrower, a bad one does no harm.

    Attributes:
        version: grows whenever it sorts anew.
    """

    def __init__(self, of: Predecessor, units: Units) -> None:
        self._units, self.version = units, 0
        self._levels, self._failed = [units.levels(one) for one in of.genomes], of.failed.tolist()
        self._old = self._fitted = len(self._failed)
        self._forest: Any = None
        self._fit()

    def learn(self, levels: Levels, *, failed: bool) -> None:
        """Learn an outcome of the run itself."""
        self._levels.append(levels)
        self._failed.append(failed)
        if len(self._failed) - self._fitted >= AGAIN:
            self._fit()

    def kinds(self, levels: NDArray[np.int64]) -> NDArray[np.int64]:
        """``(n,)`` from 0, the least likely to fail, to ``KINDS`` - 1."""
        if self._forest is None:
            return np.zeros(len(levels), dtype=np.int64)
        likely = self._forest.predict_proba(self._features(levels))[:, 1]
        return np.asarray(np.minimum((likely * KINDS).astype(np.int64), KINDS - 1))

    def _fit(self) -> None:
        from sklearn.ensemble import RandomForestClassifier  # takes a second to load

        failed, self._fitted = np.array(self._failed, dtype=bool), len(self._failed)
        if failed.any() and not failed.all():
            weights = np.where(np.arange(len(failed)) < self._old, 1.0, OWN)
            self._forest = RandomForestClassifier(TREES, min_samples_leaf=LEAF, random_state=0)
            self._forest.fit(self._features(np.array(self._levels)), failed, weights)
            self.version += 1

    def _features(self, levels: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.nan_to_num(self._units.deviations(levels), posinf=9.0)
