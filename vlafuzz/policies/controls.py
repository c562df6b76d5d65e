"""Control policies, whose results are known in advance: a measurement that contradicts them is wrong."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec


class Frozen:
    """Never moves, so it must solve no scene."""

    def __init__(self) -> None:
        self.spec = PolicySpec("frozen")

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Nothing to prepare."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(np.array([[0.0, 0, 0, 0, 0, 0, 1]])) for _ in observations]

    def close(self) -> None:
        """Nothing to close."""


class Random:
    """Moves at random, up to 5 cm and 0.2 rad per step and axis; rollouts depend on their seeds alone."""

    def __init__(self) -> None:
        self.spec = PolicySpec("random")
        self._rngs: dict[str, np.random.Generator] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for episode in episodes:
            self._rngs[episode.episode] = np.random.default_rng(episode.seed)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._draw(self._rngs[observation.episode])) for observation in observations]

    def close(self) -> None:
        self._rngs.clear()

    def _draw(self, rng: np.random.Generator) -> NDArray[np.float64]:
        scale = np.array([[0.05, 0.05, 0.05, 0.2, 0.2, 0.2, 1.0]])
        return np.asarray(rng.uniform(-1, 1, (1, 7)) * scale)
