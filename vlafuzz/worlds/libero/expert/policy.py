"""LIBERO's expert as a policy, and in the place of a policy whose actions it writes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.libero.env import HZ, METRES, RADIANS, LiberoEnv
from vlafuzz.worlds.libero.expert import TRIES, Expert

if TYPE_CHECKING:
    from vlafuzz.policies.clients.interface import Interface, Written

Array = NDArray[np.float64]
# Metres, radians and our gripper (1 is open) for one unit of an action of LIBERO's (1 is closed).
UNITS = np.array([METRES] * 3 + [RADIANS] * 3 + [-1.0])
STILL = np.array([0.0] * 6 + [1.0])


class LiberoExpert:
    """A scripted controller for LIBERO's pick-and-place tasks, which reads the simulator's state.

    ``attempt``: index of the grasp with which it begins.
    """

    spec = PolicySpec("libero-expert", action=ActionSpec(relative_to="current", hz=HZ), privileged=True)

    def __init__(self) -> None:
        self.attempt = 0
        self._plans: dict[str, Iterator[Array] | None] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._plans = {start.episode: None for start in episodes}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._next(seen)[None]) for seen in observations]

    def close(self) -> None:
        self._plans.clear()

    def _next(self, seen: Observation, pace: int = 1) -> Array:
        """The next action in metres and radians, for ``pace`` control steps."""
        if not isinstance(seen.privileged, LiberoEnv):
            raise PolicyError("LIBERO's expert acts in LIBERO's worlds only", cause="protocol")
        plan = self._plans[seen.episode]
        if plan is None:
            plan = self._plans[seen.episode] = Expert(seen.privileged, self.attempt, pace=pace).actions()
        action = next(plan, None)
        metric = STILL.copy() if action is None else action * UNITS
        metric[:6] *= pace
        return metric


class LiberoDemonstrator(LiberoExpert):
    """Decides as often as a policy does, and writes actions as that does. See ``Demonstrator``."""

    tries = TRIES

    def __init__(self, interface: Interface) -> None:
        super().__init__()
        self._interface = interface
        self.written: list[Written] = []
        self.spec = PolicySpec("libero-expert", action=interface.spec.action, state=True, privileged=True)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        super().reset(episodes)
        self.written = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._answer(seen)[None]) for seen in observations]

    def _answer(self, seen: Observation) -> Array:
        assert seen.state is not None
        written = self._interface.written(self._next(seen, HZ // self.spec.action.hz), seen.state)
        self.written.append(written)
        return self._interface.answer(written, seen.state)
