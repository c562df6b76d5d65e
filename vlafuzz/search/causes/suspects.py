"""Suspects: which units a failure is due to, as probabilities that tests narrow down."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from enum import IntEnum
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
# Share of a fault's failures that lose another stage than the attributed failure did, where chance did not come first;
# with 0.15, runs certify 3 % fewer causes at 40 % background.
STRAY = 0.05
LEAST_EFFECT = 0.2  # by which a scene fails more often inside a fault than outside
NOISY, OFTEN = 0.08, 10  # background from which a test may be repeated, and how often
TEMPER = 0.8  # power of the likelihood of other scenes: how alike two of them are is a guess
BLOCK = 40  # scenes whose likelihoods, from 1e-6, are multiplied before a logarithm is taken, which is dear
SETTLED = 2.0  # log likelihood ratio, 7 to 1, from which tests show on which side of a fault a set is


class Ended(IntEnum):
    """How a rollout ended: if it failed, whether at the stage that the failure to be attributed lost."""

    PASSED, THERE, ELSEWHERE = 0, 1, 2

    @classmethod
    def of(cls, lost: str | None, there: str | None) -> Ended:
        """Tell how a rollout ended that lost this stage or none, if the failure lost ``there``; None: unknown."""
        if lost is None:
            return cls.PASSED
        return cls.THERE if there in (lost, None) else cls.ELSEWHERE


class Suspects:
    """Sets of units that may be why a scene fails, beside the chance that nothing in it is to blame.

    Args:
        severity: ``(units,)`` chance that a value as far from the reference is in a fault; 0 where it is that of the
            reference.
        rates: ``(3,)`` probability of each of ``RATES``.
        backgrounds: ``(10,)`` probability of each of ``BACKGROUNDS``, the chance that a scene fails with nothing left
            of what is to blame.
        by_chance: probability that the failure is one of these.
        usual: share of the failures by chance that lose the same stage as this one.

    Attributes:
        smallest: set of units with which alone the scene has failed.
        tests: number of tests so far; one that is not fair counts in part.
    """

    def __init__(self, severity: Array, rates: Array, backgrounds: Array, by_chance: float, usual: float = 1.0) -> None:
        self.deviating, self._usual = severity > 0, usual
        effects = (1 - BACKGROUNDS)[:, None] * RATES
        self._rows = np.argwhere(effects >= LEAST_EFFECT)  # a background and a rate each
        outside, rate = BACKGROUNDS[self._rows[:, 0]], RATES[self._rows[:, 1]]
        self._by_background, self._outside = _by_chance(BACKGROUNDS, usual), _by_chance(outside, usual)
        self._inside = self._outside + rate * (_by_fault(outside, usual) - self._outside)
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
        self._outcomes: dict[Ended, Counter[bytes]] = {ended: Counter() for ended in Ended}
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

    def learn_scenes(self, alike: Array, ended: Sequence[Ended], otherwise: Array) -> None:
        """Learn from other scenes.

        Args:
            alike: ``(n, units)`` chance that each value is in the fault's range.
            otherwise: ``(n,)`` chance that the scene fails for another reason.
        """
        inside = np.exp(np.log(alike) @ self.masks.T.astype(float))
        each = np.array(ended), np.arange(len(alike))
        outside = _by_chance(otherwise, self._usual)[each]
        effect = _by_fault(otherwise, self._usual)[each] - outside
        blocks = np.arange(0, len(alike), BLOCK)
        for number, rate in enumerate(RATES):
            likely = np.maximum(outside[:, None] + rate * effect[:, None] * inside, 1e-6)
            logs = np.log(np.multiply.reduceat(likely, blocks, axis=0)).sum(axis=0)
            self._log[self._rows[:, 1] == number] += TEMPER * logs
        self._log_chance += TEMPER * np.log(outside).sum()
        self._weigh()

    def learn_test(self, kept: Mask, ended: Ended) -> None:
        """Learn from the scene itself with all units reset but these."""
        self.tests += 1
        partly = (self.masks & ~kept).any(axis=1)  # ``(sets,)`` whether each is not kept as a whole
        self._log += np.log(np.where(partly, self._outside[ended, :, None], self._inside[ended, :, None]))
        self._log_chance += np.log(self._by_background[ended])
        self._weigh()
        self._outcomes[ended][kept.tobytes()] += 1
        if not ended and (kept == self.smallest).all() and self.evidence(kept) < 0:
            self.smallest = self._next_smallest()
        if ended and kept.sum() < self.smallest.sum() and self.evidence(kept) > 0:
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

        A set that fails as the failure did speaks for every larger one, one that does not against every smaller one.
        """
        counts = [0, 0, 0]
        for ended, outcomes in self._outcomes.items():
            for mark, count in outcomes.items():
                smaller, larger = (_mask(mark), kept) if ended is Ended.THERE else (kept, _mask(mark))
                counts[ended] += 0 if (smaller & ~larger).any() else count
        return self.ratio(counts, self.backgrounds)

    def ratio(self, counts: Sequence[int], backgrounds: Array) -> float:
        """Log likelihood ratio of a scene's outcomes: it is in a fault, or it is not.

        Args:
            counts: of each way in which a rollout may have ``Ended``.
            backgrounds: ``(10,)`` probability of each of ``BACKGROUNDS`` outside of it.
        """
        row = self._row
        if self.deviating.sum() == 1:  # its tests are the evidence itself, and must not count twice
            row = backgrounds[self._rows[:, 0]] * self._prior_rates[self._rows[:, 1]]
        powers = np.array(counts)[:, None]
        inside = row @ (self._inside**powers).prod(axis=0) / row.sum()
        outside = backgrounds @ (self._by_background**powers).prod(axis=0)
        return float(np.log(max(inside, 1e-300)) - np.log(max(outside, 1e-300)))

    def is_unfair(self, kept: Mask) -> bool:
        """Whether the scene with these units alone is not fair."""
        return kept.tobytes() in self._unfair

    def rollouts(self, kept: Mask) -> int:
        """How often the scene with these units alone was rolled out."""
        return sum(outcomes[kept.tobytes()] for outcomes in self._outcomes.values())

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
        may_tell = [bool(kept.any()) and not self.is_unfair(kept) and self.rollouts(kept) < most for kept in candidates]
        candidates = candidates[may_tell]
        if not len(candidates):
            return None
        sizes = self.masks.sum(axis=1)
        inside = candidates.astype(float) @ self.masks.T.astype(float) == sizes
        exact = (inside & (candidates.sum(axis=1)[:, None] == sizes)) @ chances
        ends = self._inside @ self._row / self._row.sum(), self._by_background @ self.backgrounds
        gains = _information(inside @ chances, *ends)
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
        failed = [_mask(mark) for ended in (Ended.THERE, Ended.ELSEWHERE) for mark in self._outcomes[ended]]
        return min(
            (kept for kept in failed if self.evidence(kept) > 0),
            key=lambda kept: int(kept.sum()),
            default=self.deviating,
        )


@cache
def _sets(units: int) -> tuple[Mask, Array]:
    """``(n, units)`` all sets of up to four units, and ``(n,)`` the prior of their size."""
    sizes = range(1, min(len(SIZES), units) + 1)
    chosen = [list(members) for size in sizes for members in combinations(range(units), size)]
    masks = np.array([np.isin(np.arange(units), members) for members in chosen])
    return masks, np.array([SIZES[len(members) - 1] for members in chosen])


def _mask(mark: bytes) -> Mask:
    return np.frombuffer(mark, dtype=bool)


def _by_chance(background: Array, usual: float) -> Array:
    """``(3, n)`` probability of each way to end where nothing is to blame."""
    return np.stack([1 - background, background * usual, background * (1 - usual)])


def _by_fault(background: Array, usual: float) -> Array:
    """The same where a fault makes the policy fail, unless chance does so before, as in half of the cases."""
    elsewhere = (STRAY + background / 2) * (1 - usual)
    return np.stack([np.zeros_like(background), 1 - elsewhere, elsewhere])


def _information(inside: Array, kept: Array, reset: Array) -> Array:
    """Bits that a test tells about whether a fault is kept, by the probability that it is.

    ``kept``, ``reset``: ``(3,)`` probability of each way to end if it is, and if it is not.
    """
    mixed = np.outer(kept, inside) + np.outer(reset, 1 - inside)
    return np.asarray(_entropy(mixed) - inside * _entropy(kept) - (1 - inside) * _entropy(reset))


def _entropy(chances: Array) -> Array:
    chances = np.maximum(chances, 1e-9)
    return np.asarray(-(chances * np.log2(chances)).sum(axis=0))
