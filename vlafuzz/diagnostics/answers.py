"""Whether answers changed: by how much, beside how far apart they are anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import PolicySpec

Array = NDArray[np.float64]
HARDLY = 0.02  # of how much answers differ from moment to moment: less is as good as no change
ALPHA = 0.01  # of a change that is none: there are several probes


@dataclass(frozen=True)
class Change:
    """What a probe does to the answers.

    Attributes:
        size: of the change, 1 for as much as answers differ from moment to moment.
        clear: it is there, and no chance.
    """

    size: float
    clear: bool


class Answers:
    """The answers to some moments, asked twice for, so that the policy's own noise is known.

    ``noise``: how far the two answers to each moment are apart, in the unit of ``apart``.
    """

    def __init__(self, spec: PolicySpec, once: Sequence[Array], again: Sequence[Array]) -> None:
        self._spec, self._once = spec, once
        self.noise = self._distances(again)
        pairs = [apart(spec, one, other) for one, other in combinations(once, 2)]
        self._spread = float(np.mean(pairs)) if pairs else 0.0

    def change(self, probed: Sequence[Array]) -> Change:
        """What became of them. Noise is as likely to move the one answer more as the other."""
        moved = self._distances(probed)
        size = self.share(max(float(np.mean(moved - self.noise)), 0.0))
        return Change(size, size >= HARDLY and (not self.noise.any() or _greater(moved - self.noise)))

    def share(self, distance: float) -> float:
        """Of how much answers differ from moment to moment."""
        return distance / self._spread if self._spread else float(distance > 0)

    def crossed(self, probed: Sequence[Array]) -> bool:
        """Whether these would fit much better in another order."""
        from scipy.optimize import linear_sum_assignment

        costs = np.array([[apart(self._spec, one, each) for each in self._once] for one in probed])
        rows, columns = linear_sum_assignment(costs)
        return bool(costs[rows, columns].sum() < costs.trace() / 2)

    def _distances(self, others: Sequence[Array]) -> Array:
        pairs = zip(self._once, others, strict=True)
        return np.array([apart(self._spec, one, other) for one, other in pairs])


def apart(spec: PolicySpec, one: Array, other: Array) -> float:
    """Root mean square difference of two chunks: 1 for a centimetre, 0.1 rad or half the gripper."""
    action, steps = spec.action, min(len(one), len(other))
    gripper = 2.0 if action.gripper.endswith("01") else 1.0
    units = np.array([action.position_scale / 0.01] * 3 + [action.rotation_scale / 0.1] * 3 + [gripper])
    return float(np.sqrt(np.mean(((one[:steps] - other[:steps]) * units) ** 2)))


def _greater(differences: Array) -> bool:
    """Wilcoxon's signed-rank test."""
    from scipy.stats import wilcoxon

    return bool(differences.any() and wilcoxon(differences, alternative="greater").pvalue <= ALPHA)
