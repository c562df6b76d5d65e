"""LIBERO's expert as a policy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.libero.env import HZ, METRES, RADIANS

Array = NDArray[np.float64]
# Metres, radians and our gripper (1 is open) for one unit of an action of LIBERO's (1 is closed).
UNITS = np.array([METRES] * 3 + [RADIANS] * 3 + [-1.0])
STILL = np.array([0.0] * 6 + [1.0])


class LiberoExpert:
    """A scripted controller for LIBERO's pick-and-place tasks, which reads the simulator's state.

    ``attempt``: index of the grasp with which it begins.
    """

    def __init__(self) -> None:
        self.attempt = 0
        self.spec = PolicySpec(
            "libero-expert", action=ActionSpec(relative_to="current", hz=HZ), privileged=True
        )
        self._plans: dict[str, Iterator[Array] | None] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._plans = {start.episode: None for start in episodes}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [self._act(observation) for observation in observations]

    def close(self) -> None:
        self._plans.clear()

    def _act(self, observation: Observation) -> ActionChunk:
        known: Any = observation.privileged
        if known is None or not hasattr(known, "plan"):
            raise PolicyError("LIBERO's expert acts in LIBERO's worlds only", cause="protocol")
        plan = self._plans[observation.episode]
        if plan is None:
            plan = self._plans[observation.episode] = known.plan(self.attempt)
        action = next(plan, None)
        return ActionChunk((STILL if action is None else action * UNITS)[None])
