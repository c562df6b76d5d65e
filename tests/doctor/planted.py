"""Policies that answer differently in another process, and one that does not."""

import os
from collections.abc import Sequence

import numpy as np

from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec

SPEC = PolicySpec("planted", state=True)


class Planted:
    """Answers with its rollout's seed and with what ``more`` gives, centimetres."""

    spec = SPEC

    def __init__(self, more):
        self._more = more

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._seed = episodes[0].seed

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(np.full((1, 7), 0.01 * (self._seed + self._more()))) for _ in observations]

    def close(self) -> None:
        pass


def fine() -> Planted:
    return Planted(lambda: 0)


def unseeded() -> Planted:
    return Planted(np.random.random)


def by_process() -> Planted:
    return Planted(lambda: os.getpid() % 1000)


def dying() -> Planted:
    return Planted(lambda: os._exit(1))
