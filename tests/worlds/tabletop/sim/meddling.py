"""A sound policy with something done to its answers, and the two scenes that it is tried in."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import STILL, nominal, put
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.worlds.tabletop.experts.expert import Expert

NOMINAL = nominal()
ANOTHER = replace(NOMINAL, targets=(put("sponge", 0.0, 0.1, 40.0),), instruction="pick up sponge")
AT_START = pytest.approx(0.0, abs=1e-3)


Meddle = Callable[[Observation, np.ndarray], object]


class Meddled:
    """An expert with something done to its answers, in its first episodes or in all of them."""

    def __init__(self, meddle: Meddle, episodes: int | None = None) -> None:
        self._expert = Expert()
        self.spec = self._expert.spec
        self.become(meddle, episodes)

    def become(self, meddle: Meddle, episodes: int | None = None) -> None:
        self._meddle, self._left = meddle, episodes
        self.started: list[EpisodeStart] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.started += episodes
        self._expert.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> object:
        (chunk,) = self._expert.act(observations)
        if self._left is not None and len(self.started) > self._left:
            return [chunk]
        return self._meddle(observations[0], chunk.actions)

    def close(self) -> None:
        self._expert.close()


def lets_go_at(moment: Callable[[Observation], bool], times: int = 1) -> Meddled:
    """When it has met that moment so many times it opens its gripper and stays."""
    met: list[bool] = []

    def meddle(observation: Observation, actions: np.ndarray) -> list[ActionChunk]:
        met.extend([True] if moment(observation) else [])
        return [ActionChunk(STILL[None] if len(met) >= times else actions)]

    return Meddled(meddle)


def is_lifted(observation: Observation) -> bool:
    return bool(observation.privileged.state.positions[0, 2] > 0.0615 + 0.025)
