"""Disturbances of demonstrations: the expert shows how to recover from what it would not do itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DISTURBED = 0.75  # share of episodes
DRIVEN, LONGEST_DRIVE = 0.7, 45  # share of episodes that a driver begins, and its maximum steps


class Disturbance:
    """What disturbs one episode: a driver of its first steps, noise, random steps, a gripper that slips."""

    def __init__(self, seed: int, *, driven: bool) -> None:
        self._rng = np.random.default_rng([seed, 1])
        disturbed = self._rng.random() < DISTURBED
        self._sigma = self._rng.uniform(0.05, 0.3) if disturbed else 0.0
        self._wild = int(self._rng.integers(1, 5)) if disturbed and self._rng.random() < 0.5 else 0
        driven = driven and self._rng.random() < DRIVEN
        self._driven = int(self._rng.integers(1, LONGEST_DRIVE)) if driven else 0

    def is_driven(self, step: int) -> bool:
        """Whether the driver acts in a step."""
        return step < self._driven

    def executed(self, step: int, label: NDArray[np.float64], away: float) -> NDArray[np.float64]:
        """What is executed instead of the expert's action. ``away``: metres from the hand to the object."""
        if self._sigma == 0.0:
            return label
        action, rng = label.copy(), self._rng
        if self._driven <= step < self._driven + self._wild:
            action[:3] = rng.uniform((-0.08, -0.08, -0.06), (0.08, 0.08, 0.10))
            action[5] = rng.uniform(-0.5, 0.5)
            return action
        strength = self._sigma * min(away / 0.15, 1.0)
        action[:3] += rng.normal(0, 0.1 * strength, 3)
        action[5] += rng.normal(0, 0.6 * strength)
        if rng.random() < 0.01:
            action[6] = -action[6]
        return action
