"""Policies of known skill without a simulator, with and without corrections, one of which matters."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from tests.doubles import failed, passed, scene
from vlafuzz.doctor import Check
from vlafuzz.doctor.wiring import Correction, check_wiring
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene

CORRECTIONS = [Correction(fault=f"fault {number}", advice="") for number in range(14)]
Law = Callable[[np.random.Generator], float]  # progress of a rollout; from 1 on it succeeds


def skilled(rate: float, otherwise: float = 0.25) -> Law:
    """Success at a rate, else a progress around ``otherwise``."""

    def progress(rng: np.random.Generator) -> float:
        return 1.0 if rng.random() < rate else rng.beta(6 * otherwise, 6 * (1 - otherwise))

    return progress


def spread(mean: float, deviation: float) -> Law:
    return lambda rng: rng.normal(mean, deviation)


NOTHING = skilled(0.0, 0.12)


@dataclass
class Simulated:
    """A policy that follows a law, ``corrected`` with the right correction, else ``wrong`` with any other.

    ``affected``: share of the scenes in which it is not as if corrected anyway.
    """

    seed: tuple[int, ...]
    plain: Law
    corrected: Law
    affected: float = 1.0
    wrong: Law = NOTHING
    rolled: int = 0
    right: Correction = field(init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self.right = CORRECTIONS[self._rng.integers(len(CORRECTIONS))]

    def roll(self, of: Scene, tried: Correction | None) -> Outcome:
        self.rolled += 1
        spared = np.random.default_rng(int(of.digest, 16)).random() >= self.affected
        fine = tried is self.right or (tried is None and spared)
        law = self.corrected if fine else self.plain if tried is None else self.wrong
        progress = law(self._rng)
        return passed() if progress >= 1 else failed(max(progress, 0.0))

    def checked(self) -> Check:
        """The result of the check after ten nominal scenes."""
        scenes = [scene(x=number / 1000) for number in range(10)]
        fresh = (scene(x=-number / 1000) for number in count(1))
        outcomes = [(case, self.roll(case, None)) for case in scenes]
        return check_wiring(outcomes, fresh, CORRECTIONS, self.roll)

    def called(self) -> str | None:
        """The fault for which it is called miswired, if any."""
        row = self.checked()
        return row.found.partition(":")[0] if row.verdict == "refuse" else None
