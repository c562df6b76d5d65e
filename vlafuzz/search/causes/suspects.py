"""Suspects: which units a failure is due to, as probabilities that tests narrow down."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]  # (units,)
Numbers = NDArray[np.float64]

SIZES = (0.45, 0.33, 0.18, 0.04)  # prior of one, two, three and four units
ELSEWISE = 0.04  # chance that a scene fails in which nothing but the suspects is reset: by another fault
MISSED = 0.01  # chance that a suspect's absence does not matter
HALVES = 48  # random sets of units that are considered as a test
EXACT = 0.3
SURELY, AGAIN = 0.93, 3  # failure rate from which one test is enough; else up to three
RIVALS = 12  # most likely suspects whose unions and differences are considered


class Suspects:
    """Sets of units that may be why a scene fails.

    Args:
        deviating: ``(units,)`` that differ from the reference.
        severity: ``(units,)`` chance that a value as far from the reference is in a fault.
        rate: of failure inside a fault.
    """

    def __init__(self, deviating: Mask, severity: Numbers, rate: float) -> None:
        units = np.flatnonzero(deviating)
        masks, prior = [], []
        for size, weight in enumerate(SIZES[: len(units)], 1):
            chosen = list(combinations(units, size))
            for members in chosen:
                mask = np.zeros(len(deviating), dtype=bool)
                mask[list(members)] = True
                masks.append(mask)
            some = np.array([np.prod(severity[list(members)]) for members in chosen])
            prior.append(weight * some / some.sum())
        self.masks = np.array(masks)
        self._log = np.log(np.concatenate(prior))
        self.rate, self.deviating = rate, deviating
        self.tests = 0
        self.log: list[tuple[Mask, bool]] = []
        self.smallest = deviating  # set of units with which alone the scene has failed
        self._confirmed = np.zeros(len(self.masks), dtype=bool)
        self._impossible: set[bytes] = set()
        self._tried: Counter[bytes] = Counter()
        self._passes: list[Mask] = []  # sets of units with which alone it has passed, or cannot be fair

    @property
    def chances(self) -> Numbers:
        """``(n,)`` the probability of each set."""
        weights = np.exp(self._log - self._log.max())
        return np.asarray(weights / weights.sum())

    def learn_scenes(self, alike: Numbers, failed: Mask, otherwise: Numbers) -> None:
        """Learn from other scenes.

        Args:
            alike: ``(n, units)`` chance that each value is in the fault's range.
            otherwise: ``(n,)`` chance that the scene fails for another reason.
        """
        inside = self.rate * np.exp(np.log(alike) @ self.masks.T.astype(float))
        failing = inside + (1 - inside) * otherwise[:, None]
        likely = np.where(failed[:, None], failing, 1 - failing)
        self._log += np.log(np.clip(likely, 1e-6, None)).sum(axis=0)

    def learn_test(self, kept: Mask, *, failed: bool) -> None:
        """Learn from the scene itself with all units reset but these."""
        self.tests += 1
        self.log.append((kept, failed))
        self._tried[kept.tobytes()] += 1
        inside = ~(self.masks & ~kept).any(axis=1)
        failing = np.where(inside, self.rate + (1 - self.rate) * ELSEWISE, ELSEWISE)
        self._log += np.log(failing if failed else 1 - failing)
        if not failed:
            self._passes.append(kept)
            return
        self._confirmed |= (self.masks == kept).all(axis=1)
        if kept.sum() < self.smallest.sum():
            self.smallest = kept

    def best(self) -> tuple[Mask, float, bool]:
        """The most likely set, its probability, and whether the scene with it alone has failed."""
        chances = self.chances
        top = int(np.argmax(chances))
        return self.masks[top], float(chances[top]), bool(self._confirmed[top])

    def rule_out(self, kept: Mask) -> None:
        """The scene with these units alone is not fair."""
        self._passes.append(kept)
        self._impossible.add(kept.tobytes())

    def without_one(self) -> Mask | None:
        """The smallest failing set with one unit less, the least likely first; None if all are tried."""
        weights = self.chances @ self.masks
        units = np.flatnonzero(self.smallest)
        for unit in units[np.argsort(weights[units], kind="stable")] if len(units) > 1 else ():
            kept = self.smallest.copy()
            kept[unit] = False
            if not any(not (kept & ~passing).any() for passing in self._passes):
                return kept
        return None

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the most informative test; None if nothing new can be learnt."""
        chances = self.chances
        ranked = self.masks[np.argsort(-chances)[:RIVALS]]
        unions = [a | b for a, b in combinations(ranked[:6], 2)]
        halves = rng.random((HALVES, len(self.deviating))) < rng.uniform(0.3, 0.8, (HALVES, 1))
        without = [self.deviating & ~mask for mask in ranked]
        candidates = np.concatenate([ranked, unions or ranked, halves & self.deviating, without])
        new = np.array([candidate.any() and self._open(candidate) for candidate in candidates])
        if not new.any():
            return None
        candidates = candidates[new]
        inside = ~(self.masks[None] & ~candidates[:, None]).any(axis=2)
        fails = self.rate * (inside @ chances) + ELSEWISE * (1 - inside @ chances)
        exact = (self.masks[None] == candidates[:, None]).all(axis=2) @ chances
        best = int(np.argmax(_entropy(fails) + EXACT * exact))
        return np.asarray(candidates[best])

    def _open(self, kept: Mask) -> bool:
        """Whether a test may still tell something: a sure answer is not asked for again."""
        mark = kept.tobytes()
        if mark in self._impossible:
            return False
        return self._tried[mark] < (1 if self.rate > SURELY else AGAIN)


def _entropy(chance: Numbers) -> Numbers:
    chance = np.clip(chance, 1e-9, 1 - 1e-9)
    return np.asarray(-chance * np.log2(chance) - (1 - chance) * np.log2(1 - chance))
