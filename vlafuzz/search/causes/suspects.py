"""Suspects: which units a failure is due to, as probabilities that tests narrow down."""

from __future__ import annotations

from collections import Counter
from functools import cache
from itertools import combinations

import numpy as np

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.search.causes.background import RATES as BACKGROUNDS

SIZES = (0.45, 0.33, 0.18, 0.04)  # prior of one, two, three and four units
RATES = np.array([0.98, 0.75, 0.5])  # of failure due to a fault, inside of it; one of them holds
RATE_PRIOR = np.array([0.6, 0.25, 0.15])
HALVES = 100  # random sets of units that are considered as a test
EXACT = 0.4  # worth of a test that may end the attribution, as a share of the most that a test can tell
UNFAIR = 0.25  # of a test, in the number of tests: it takes time, but no rollout
RIVALS = 12  # most likely suspects whose unions and differences are considered
FIRM, AGAIN = 0.93, 3  # expected rate from which one test is enough; else up to three
LEAST_EFFECT = 0.2  # by which a scene fails more often inside a fault than outside
NOISY, OFTEN = 0.08, 10  # background from which a test may be repeated, and how often
TEMPER = 0.8  # power of the likelihood of other scenes: how alike two of them are is a guess
BLOCK = 40  # scenes whose likelihoods, from 1e-6, are multiplied before a logarithm is taken, which is dear
SETTLED = 2.0  # log likelihood ratio, 7 to 1, from which tests show on which side of a fault a set is


class Suspects:
    """Sets of units that may be why a scene fails, beside the chance that nothing in it is to blame.

    Args:
        severity: ``(units,)`` chance that a value as far from the reference is in a fault; 0 where it is that of the
            reference.
        rates: ``(3,)`` probability of each of ``RATES``.
        backgrounds: ``(10,)`` probability of each of ``BACKGROUNDS``, the chance that a scene fails with nothing left
            of what is to blame.
        by_chance: probability that the failure is one of these.

    Attributes:
        smallest: set of units with which alone the scene has failed.
        tests: number of tests so far; one that is not fair counts in part.
    """

    def __init__(self, severity: Array, rates: Array, backgrounds: Array, by_chance: float) -> None:
        self.deviating = severity > 0
        effects = (1 - BACKGROUNDS)[:, None] * RATES
        self._rows = np.argwhere(effects >= LEAST_EFFECT)  # a background and a rate each
        self._outside = BACKGROUNDS[self._rows[:, 0]]
        self._inside = self._outside + effects[tuple(self._rows.T)]
        inside, weights = _sets(int(self.deviating.sum()))
        self.masks = np.zeros((len(inside), len(severity)), dtype=bool)
        self.masks[:, self.deviating] = inside
        plausible, sizes = np.where(inside, severity[self.deviating], 1.0).prod(axis=1), inside.sum(axis=1)
        sets = weights * plausible / np.bincount(sizes, plausible)[sizes]
        row = backgrounds[self._rows[:, 0]] * rates[self._rows[:, 1]]
        self._prior_rates = rates
        self._log = np.log(row / row.sum())[:, None] + np.log(sets / sets.sum() * (1 - by_chance))
        self._log_chance = np.log(backgrounds * by_chance)
        self._weigh()
        self.tests, self.smallest = 0.0, self.deviating
        self._failures: Counter[bytes] = Counter()
        self._passes: Counter[bytes] = Counter()
        self._unfair: set[bytes] = set()

    @property
    def backgrounds(self) -> Array:
        """``(10,)`` the probability of each of ``BACKGROUNDS``."""
        return np.asarray(self._by_chance + np.bincount(self._rows[:, 0], self._row, len(BACKGROUNDS)))

    @property
    def by_chance(self) -> float:
        """The probability that no unit is to blame for the failure."""
        return float(self._by_chance.sum())

    @property
    def entropy(self) -> float:
        """How uncertain it is which set is to blame, in bits, if one is."""
        chances = self.chances[self.chances > 0] / self.chances.sum()
        return float(-(chances @ np.log2(chances)))

    @property
    def rates(self) -> Array:
        """``(3,)`` the probability of each of ``RATES``, if a unit is to blame."""
        rates = np.bincount(self._rows[:, 1], self._row, len(RATES))
        return np.asarray(rates / rates.sum())

    @property
    def rate(self) -> float:
        """The expected rate of failures due to the fault, inside of it."""
        return float(self.rates @ RATES)

    def learn_scenes(self, alike: Array, failed: Mask, otherwise: Array) -> None:
        """Learn from other scenes.

        Args:
            alike: ``(n, units)`` chance that each value is in the fault's range.
            otherwise: ``(n,)`` chance that the scene fails for another reason.
        """
        inside = np.exp(np.log(alike) @ self.masks.T.astype(float))
        outside = np.where(failed, otherwise, 1 - otherwise)
        effect = np.where(failed, 1 - otherwise, otherwise - 1)
        blocks = np.arange(0, len(alike), BLOCK)
        for number, rate in enumerate(RATES):
            likely = np.maximum(outside[:, None] + rate * effect[:, None] * inside, 1e-6)
            logs = np.log(np.multiply.reduceat(likely, blocks, axis=0)).sum(axis=0)
            self._log[self._rows[:, 1] == number] += TEMPER * logs
        self._log_chance += TEMPER * np.log(outside).sum()
        self._weigh()

    def learn_test(self, kept: Mask, *, failed: bool) -> None:
        """Learn from the scene itself with all units reset but these."""
        self.tests += 1
        partly = (self.masks & ~kept).any(axis=1)  # ``(sets,)`` whether each is not kept as a whole
        failing = np.where(partly, self._outside[:, None], self._inside[:, None])
        self._log += np.log(failing if failed else 1 - failing)
        self._log_chance += np.log(BACKGROUNDS if failed else 1 - BACKGROUNDS)
        self._weigh()
        (self._failures if failed else self._passes)[kept.tobytes()] += 1
        if not failed and (kept == self.smallest).all() and self.evidence(kept) < 0:
            self.smallest = self._next_smallest()
        if failed and kept.sum() < self.smallest.sum() and self.evidence(kept) > 0:
            self.smallest = kept

    def rule_out(self, kept: Mask) -> None:
        """The scene with these units alone is not fair."""
        self.tests += UNFAIR
        self._unfair.add(kept.tobytes())

    def best(self) -> tuple[float, bool]:
        """The probability of the most likely set, and whether tests show that it is in a fault."""
        chances = self.chances
        top = int(np.argmax(chances))
        return float(chances[top]), self.evidence(self.masks[top]) >= SETTLED

    def evidence(self, kept: Mask) -> float:
        """Log likelihood ratio of the tests: the scene with these units alone is in a fault, or it is not.

        A set that fails speaks for every larger one, a set that passes against every smaller one.
        """
        failures = sum(count for mark, count in self._failures.items() if not (_mask(mark) & ~kept).any())
        passes = sum(count for mark, count in self._passes.items() if not (kept & ~_mask(mark)).any())
        return self.ratio(failures, passes, self.backgrounds)

    def ratio(self, failures: int, passes: int, backgrounds: Array) -> float:
        """Log likelihood ratio of so many outcomes in a scene: it is in a fault, or it is not.

        Args:
            backgrounds: ``(10,)`` probability of each of ``BACKGROUNDS`` outside of it.
        """
        row = self._row
        if self.deviating.sum() == 1:  # its tests are the evidence itself, and must not count twice
            row = backgrounds[self._rows[:, 0]] * self._prior_rates[self._rows[:, 1]]
        inside = row @ (self._inside**failures * (1 - self._inside) ** passes) / row.sum()
        outside = backgrounds @ (BACKGROUNDS**failures * (1 - BACKGROUNDS) ** passes)
        return float(np.log(max(inside, 1e-300)) - np.log(max(outside, 1e-300)))

    def is_unfair(self, kept: Mask) -> bool:
        """Whether the scene with these units alone is not fair."""
        return kept.tobytes() in self._unfair

    def rollouts(self, kept: Mask) -> int:
        """How often the scene with these units alone was rolled out."""
        return self._failures[kept.tobytes()] + self._passes[kept.tobytes()]

    def without_one(self) -> Mask | None:
        """The smallest failing set with one unit less, the least likely first; None if all are tried."""
        weights = self.chances @ self.masks
        units = np.flatnonzero(self.smallest)
        for unit in units[np.argsort(weights[units], kind="stable")] if len(units) > 1 else ():
            kept = self.smallest.copy()
            kept[unit] = False
            if self.evidence(kept) > -SETTLED and kept.tobytes() not in self._unfair:
                return kept
        return None

    def next_test(self, rng: np.random.Generator) -> Mask | None:
        """The units to keep in the most informative test; None if nothing new can be learnt."""
        chances = self.chances
        ranked = self.masks[np.argsort(-chances)[:RIVALS]]
        unions = [one | other for one, other in combinations(ranked[:6], 2)]
        halves = rng.random((HALVES, len(self.deviating))) < rng.uniform(0.3, 0.8, (HALVES, 1))
        noisy = float(self.backgrounds @ BACKGROUNDS) > NOISY
        whole = [self.deviating] if noisy else []
        candidates = np.concatenate([[*ranked, *unions, *whole], halves & self.deviating, self.deviating & ~ranked])
        most = OFTEN if noisy else 1 if self.rate > FIRM else AGAIN
        candidates = candidates[[bool(kept.any()) and self._is_open(kept, most) for kept in candidates]]
        if not len(candidates):
            return None
        sizes = self.masks.sum(axis=1)
        inside = candidates.astype(float) @ self.masks.T.astype(float) == sizes
        exact = (inside & (candidates.sum(axis=1)[:, None] == sizes)) @ chances
        rate = float(self._row @ self._inside / self._row.sum())
        gains = _information(inside @ chances, rate, float(self.backgrounds @ BACKGROUNDS))
        return np.asarray(candidates[int(np.argmax(gains + EXACT * gains.max() * exact))])

    def _weigh(self) -> None:
        """Turn logarithms into probabilities: of the sets, of the rows, and of chance by background."""
        most = max(float(self._log.max()), float(self._log_chance.max()))
        weights, chance = np.exp(self._log - most), np.exp(self._log_chance - most)
        total = float(weights.sum() + chance.sum())
        self.chances: Array = weights.sum(axis=0) / total  # of the sets; what is missing to 1 is chance
        self._row: Array = weights.sum(axis=1) / total
        self._by_chance: Array = chance / total

    def _next_smallest(self) -> Mask:
        """The smallest set for which tests speak that it fails; all units if they do for none."""
        failed = [_mask(mark) for mark in self._failures]
        return min(
            (kept for kept in failed if self.evidence(kept) > 0),
            key=lambda kept: int(kept.sum()),
            default=self.deviating,
        )

    def _is_open(self, kept: Mask, most: int) -> bool:
        """Whether a test may still tell something: a sure answer is not asked for again."""
        mark = kept.tobytes()
        return mark not in self._unfair and self._failures[mark] + self._passes[mark] < most


@cache
def _sets(units: int) -> tuple[Mask, Array]:
    """``(n, units)`` all sets of up to four units, and ``(n,)`` the prior of their size."""
    sizes = range(1, min(len(SIZES), units) + 1)
    chosen = [list(members) for size in sizes for members in combinations(range(units), size)]
    masks = np.array([np.isin(np.arange(units), members) for members in chosen])
    return masks, np.array([SIZES[len(members) - 1] for members in chosen])


def _mask(mark: bytes) -> Mask:
    return np.frombuffer(mark, dtype=bool)


def _information(inside: Array, rate: float, otherwise: float) -> Array:
    """Bits that a test tells about whether a fault is kept, by the probability that it is."""
    fails = otherwise + (rate - otherwise) * inside
    chance = inside * _entropy(np.array(rate)) + (1 - inside) * _entropy(np.array(otherwise))
    return np.asarray(_entropy(fails) - chance)


def _entropy(chance: Array) -> Array:
    chance = np.clip(chance, 1e-9, 1 - 1e-9)
    return np.asarray(-chance * np.log2(chance) - (1 - chance) * np.log2(1 - chance))
