"""How much a probe changes a policy's answers, relative to how much they differ between time steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import PolicySpec

Array = NDArray[np.float64]
HARDLY = 0.02  # relative size below which a change does not count
ALPHA = 0.01  # significance level; low, since there are several probes


@dataclass(frozen=True)
class Change:
    """The effect of a probe on the answers.

    Attributes:
        size: relative to the mean distance between the answers to different moments.
        clear: it is large enough, and statistically significant.
    """

    size: float
    clear: bool


class Answers:
    """Two answers to each of some moments, from which the policy's own noise is known.

    ``noise``: the distance between the two answers to each moment, see ``apart``.
    """

    def __init__(self, spec: PolicySpec, first: Sequence[Array], second: Sequence[Array]) -> None:
        self._spec, self._first = spec, first
        self.noise = self._distances(second)
        pairs = [apart(spec, a, b) for a, b in combinations(first, 2)]
        self._spread = float(np.mean(pairs)) if pairs else 0.0

    def change(self, probed: Sequence[Array]) -> Change:
        """The change to the probed answers, beyond the noise, which moves both answers alike."""
        moved = self._distances(probed)
        size = self.relative(max(float(np.mean(moved - self.noise)), 0.0))
        return Change(size, size >= HARDLY and (not self.noise.any() or _greater(moved - self.noise)))

    def relative(self, distance: float) -> float:
        """A distance relative to the mean distance between the answers to different moments."""
        return distance / self._spread if self._spread else float(distance > 0)

    def crossed(self, probed: Sequence[Array]) -> bool:
        """Whether the probed answers would fit the moments much better in another order."""
        from scipy.optimize import linear_sum_assignment

        costs = np.array([[apart(self._spec, a, b) for b in self._first] for a in probed])
        rows, columns = linear_sum_assignment(costs)
        return bool(costs[rows, columns].sum() < costs.trace() / 2)

    def _distances(self, others: Sequence[Array]) -> Array:
        pairs = zip(self._first, others, strict=True)
        return np.array([apart(self._spec, a, b) for a, b in pairs])


def apart(spec: PolicySpec, a: Array, b: Array) -> float:
    """Root mean square distance of two chunks; 1 cm, 0.1 rad and half the gripper's range count as 1 each."""
    action, steps = spec.action, min(len(a), len(b))
    gripper = 2.0 if action.gripper.endswith("01") else 1.0
    units = np.array([action.position_scale / 0.01] * 3 + [action.rotation_scale / 0.1] * 3 + [gripper])
    return float(np.sqrt(np.mean(((a[:steps] - b[:steps]) * units) ** 2)))


def _greater(differences: Array) -> bool:
    """Whether the differences are significantly positive, by Wilcoxon's signed-rank test."""
    from scipy.stats import wilcoxon

    return bool(differences.any() and wilcoxon(differences, alternative="greater").pvalue <= ALPHA)
