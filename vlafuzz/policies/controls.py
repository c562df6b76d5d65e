"""Policies that do not look: controls, whose results are known in advance, and one that executes given actions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.harness import WIDTH


class Frozen:
    """Never moves, so it must solve no scene."""

    def __init__(self) -> None:
        self.spec = PolicySpec("frozen")

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Do nothing: there is no state."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(np.array([[0.0, 0, 0, 0, 0, 0, 1]])) for _ in observations]

    def close(self) -> None:
        """Do nothing."""


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


class Player(Frozen):
    """Executes ``actions``, ``(steps, width)``, which are set before a rollout, whatever it sees; then holds still."""

    def __init__(self, like: PolicySpec) -> None:
        self.spec = PolicySpec("witness", action=like.action)
        self.actions: NDArray[np.floating[Any]] = np.zeros((0, like.action.width), dtype=np.float32)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._at(observation.step)[None]) for observation in observations]

    def _at(self, step: int) -> Array:
        if step < len(self.actions):
            return np.array(self.actions[step], dtype=np.float64)
        still = np.zeros(self.spec.action.width)
        if len(still) == WIDTH:
            still[-1] = self.actions[-1, -1] if len(self.actions) else 1.0  # the gripper
        return still
