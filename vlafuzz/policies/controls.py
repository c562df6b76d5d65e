"""Control policies, whose results are known in advance: a measurement that contradicts them is wrong."""

from collections.abc import Sequence

import numpy as np

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

    FARTHEST = np.array([0.05, 0.05, 0.05, 0.2, 0.2, 0.2, 1.0])

    def __init__(self) -> None:
        self.spec = PolicySpec("random")
        self._rngs: dict[str, np.random.Generator] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._rngs |= {start.episode: np.random.default_rng(start.seed) for start in episodes}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        draws = (self._rngs[seen.episode].uniform(-1, 1, (1, 7)) for seen in observations)
        return [ActionChunk(draw * self.FARTHEST) for draw in draws]

    def close(self) -> None:
        self._rngs.clear()
