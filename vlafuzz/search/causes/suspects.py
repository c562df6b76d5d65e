"""Suspects: which units a failure is due to, as probabilities that tests narrow down."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]  # (units,)
Numbers = NDArray[np.float64]

SIZES = (0.45, 0.33, 0.18, 0.04)  # prior of one, two, three and four units
RATES = np.array([0.98, 0.75, 0.5])  # of failure inside a fault, of which one holds
RATE_PRIOR = np.array([0.6, 0.25, 0.15])
OTHERWISE = 0.04  # chance that a scene fails with nothing left of what is to blame: by another fault
HALVES = 100  # random sets of units that are considered as a test
EXACT = 0.3  # worth in bits of a test that may end the attribution
UNFAIR = 0.25  # of a test, in the number of tests: it takes time, but no rollout
RIVALS = 12  # most likely suspects whose unions and differences are considered
FIRM, AGAIN = 0.93, 3  # expected failure rate from which one test is enough; else up to three


class Suspects:
    """Sets of units that may be why a scene fails.

    Args:
        severity: ``(units,)`` chance that a value as far from the reference is in a fault; 0 where it is that
            of the reference.
        rates: ``(3,)`` probability of each of ``RATES``.

    Attributes:
        smallest: set of units with which alone the scene has failed.
        tests: number of tests so far; one that is not fair counts in part.
    """

    def __init__(self, severity: Numbers, rates: Numbers) -> None:
        self.deviating = severity > 0
        units = np.flatnonzero(self.deviating)
        masks, prior = [], []
        for size, weight in enumerate(SIZES[: len(units)], 1):
            chosen = [list(members) for members in combinations(units, size)]
            masks += [np.isin(np.arange(len(severity)), members) for members in chosen]
            plausible = np.array([severity[members].prod() for members in chosen])
            prior.append(weight * plausible / plausible.sum())
        self.masks = np.array(masks)
        self._log = np.log(rates)[:, None] + np.log(np.concatenate(prior))
        self.tests, self.smallest = 0.0, self.deviating
        self._failed = np.zeros(len(self.masks), dtype=bool)
        self._tried: Counter[bytes] = Counter()
        self._passed: Counter[bytes] = Counter()
        self._unfair: set[bytes] = set()

    @property
    def chances(self) -> Numbers:
        """``(sets,)`` the probability of each set."""
        return np.asarray(self._joint().sum(axis=0))

    @property
    def rates(self) -> Numbers:
        """``(3,)`` the probability of each of ``RATES``."""
        return np.asarray(self._joint().sum(axis=1))

    @property
    def rate(self) -> float:
        """The expected failure rate inside the fault."""
        return float(self.rates @ RATES)

    def learn_scenes(self, alike: Numbers, failed: Mask, otherwise: Numbers) -> None:
        """Learn from other scenes.

        Args:
            alike: ``(n, units)`` chance that each value is in the fault's range.
            otherwise: ``(n,)`` chance that the scene fails for another reason.
        """
        inside = np.exp(np.log(alike) @ self.masks.T.astype(float))
        for row, rate in enumerate(RATES):
            failing = rate * inside + (1 - rate * inside) * otherwise[:, None]
            likely = np.where(failed[:, None], failing, 1 - failing)
            self._log[row] += np.log(np.clip(likely, 1e-6, None)).sum(axis=0)

    def learn_test(self, kept: Mask, *, failed: bool) -> None:
        """Learn from the scene itself with all units reset but these."""
        self.tests += 1
        self._tried[kept.tobytes()] += 1
        failing = np.where(self._inside(kept), RATES[:, None], OTHERWISE)
        self._log += np.log(failing if failed else 1 - failing)
        if not failed:
            self._passed[kept.tobytes()] += 1
            return
        self._failed |= (self.masks == kept).all(axis=1)
        if kept.sum() < self.smallest.sum():
            self.smallest = kept

    def rule_out(self, kept: Mask) -> None:
        """The scene with these units alone is not fair."""
        self.tests += UNFAIR
        self._unfair.add(kept.tobytes())

    def best(self) -> tuple[float, bool]:
        """The probability of the most likely set, and whether the scene with it alone has failed."""
        chances = self.chances
        top = int(np.argmax(chances))
        return float(chances[top]), bool(self._failed[top])

    def without_one(self) -> Mask | None:
        """The smallest failing set with one unit less, the least likely first; None if all are tried."""
        weights = self.chances @ self.masks
        units = np.flatnonzero(self.smallest)
        for unit in units[np.argsort(weights[units], kind="stable")] if len(units) > 1 else ():
            kept = self.smallest.copy()
            kept[unit] = False
            if not self._passes(kept):
                return kept
        return None

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the most informative test; None if nothing new can be learnt."""
        chances = self.chances
        ranked = self.masks[np.argsort(-chances)[:RIVALS]]
        unions = [one | other for one, other in combinations(ranked[:6], 2)]
        halves = rng.random((HALVES, len(self.deviating))) < rng.uniform(0.3, 0.8, (HALVES, 1))
        candidates = np.concatenate([[*ranked, *unions], halves & self.deviating, self.deviating & ~ranked])
        most = 1 if self.rate > FIRM else AGAIN
        candidates = candidates[[bool(kept.any()) and self._is_open(kept, most) for kept in candidates]]
        if not len(candidates):
            return None
        sizes = self.masks.sum(axis=1)
        inside = candidates.astype(float) @ self.masks.T.astype(float) == sizes
        exact = (inside & (candidates.sum(axis=1)[:, None] == sizes)) @ chances
        gains = _information(inside @ chances, self.rate)
        return np.asarray(candidates[int(np.argmax(gains + EXACT * exact))])

    def _joint(self) -> Numbers:
        weights = np.exp(self._log - self._log.max())
        return np.asarray(weights / weights.sum())

    def _inside(self, kept: Mask) -> Mask:
        """``(sets,)`` whether each is kept as a whole."""
        return np.asarray(~(self.masks & ~kept).any(axis=1))

    def _passes(self, kept: Mask) -> bool:
        """Whether tests show, or fairness prevents, that the scene fails with these units alone."""
        enough = 1 if self.rate > FIRM else 2
        passes = sum(
            count
            for mark, count in self._passed.items()
            if not (kept & ~np.frombuffer(mark, dtype=bool)).any()
        )
        return passes >= enough or kept.tobytes() in self._unfair

    def _is_open(self, kept: Mask, most: int) -> bool:
        """Whether a test may still tell something: a sure answer is not asked for again."""
        mark = kept.tobytes()
        return mark not in self._unfair and self._tried[mark] < most


def _information(inside: Numbers, rate: float) -> Numbers:
    """Bits that a test tells about whether a fault is kept, by the probability that it is."""
    fails = OTHERWISE + (rate - OTHERWISE) * inside
    chance = inside * _entropy(np.array(rate)) + (1 - inside) * _entropy(np.array(OTHERWISE))
    return np.asarray(_entropy(fails) - chance)


def _entropy(chance: Numbers) -> Numbers:
    chance = np.clip(chance, 1e-9, 1 - 1e-9)
    return np.asarray(-chance * np.log2(chance) - (1 - chance) * np.log2(1 - chance))
