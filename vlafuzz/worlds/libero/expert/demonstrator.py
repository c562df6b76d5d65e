"""LIBERO's expert in the place of a policy; its actions are written as that policy writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.clients.interface import Interface, Written
from vlafuzz.worlds.libero.env import HZ
from vlafuzz.worlds.libero.expert import TRIES
from vlafuzz.worlds.libero.expert.policy import STILL, UNITS


class LiberoDemonstrator:
    """Decides as often as the policy does. See ``worlds.base.Demonstrator``."""

    tries = TRIES

    def __init__(self, interface: Interface) -> None:
        self._interface = interface
        self.attempt, self.written = 0, list[Written]()
        self.spec = PolicySpec("libero-expert", action=interface.spec.action, state=True, privileged=True)
        self._pace = HZ // self.spec.action.hz

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.written = []
        self._plan: Iterator[NDArray[np.float64]] | None = None

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [self._act(seen) for seen in observations]

    def close(self) -> None:
        self._plan = None

    def _act(self, seen: Observation) -> ActionChunk:
        known: Any = seen.privileged
        if known is None or seen.state is None:
            raise PolicyError("the expert needs the simulator's state, and got none", cause="protocol")
        if self._plan is None:
            self._plan = known.plan(self.attempt, self._pace)
        action = next(self._plan, None)
        metric = STILL.copy() if action is None else action * UNITS
        metric[:6] *= self._pace
        written = self._interface.written(metric, seen.state)
        self.written.append(written)
        return ActionChunk(self._interface.answer(written, seen.state)[None])
