"""The tabletop's expert in the place of a policy; its actions are written as that policy writes them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.clients.interface import Interface, Written
from vlafuzz.worlds.tabletop.experts.expert import ATTEMPTS, Expert

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Of the hand: ``place`` (3,) metres."""

    place: Array
    turn: Rotation

    def moved(self, move: Array) -> "Pose":
        """After a move of ``(6,)``: metres, and a rotation vector about the base's axes."""
        return Pose(self.place + move[:3], Rotation.from_rotvec(move[3:6]) * self.turn)

    def move_to(self, other: "Pose") -> Array:
        """The move from here to another pose."""
        return np.concatenate([other.place - self.place, (other.turn * self.turn.inv()).as_rotvec()])


class TabletopDemonstrator:
    """Decides as often as the expert does, and spreads each of its moves over the policy's control steps.

    Actions are rounded as the policy's interface writes them, so that what is executed is what was written. The second
    half of its attempts are those of the expert that waits, which solves what the fluent one does not. See
    ``worlds.base.Demonstrator``.
    """

    tries = 2 * ATTEMPTS

    def __init__(self, interface: Interface) -> None:
        self._interface = interface
        self._experts = (Expert(fluent=True), Expert())
        self.attempt, self.written = 0, list[Written]()
        # An action is given in what the spec of the policy says; pictures are not needed.
        flat = interface.spec.silhouettes and not interface.spec.cameras
        self.spec = PolicySpec("expert", action=interface.spec.action, silhouettes=flat, state=True, privileged=True)
        self._parts = max(1, self.spec.action.hz // ActionSpec().hz)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        waits, attempt = divmod(self.attempt, ATTEMPTS)
        self._expert = self._experts[waits]
        self._expert.attempt = attempt
        self._expert.reset(episodes)
        self.written = []
        self._aim: Pose | None = None  # where the hand was told to be

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [self._act(seen) for seen in observations]

    def close(self) -> None:
        for expert in self._experts:
            expert.close()

    def _act(self, seen: Observation) -> ActionChunk:
        known, hand = seen.privileged, seen.state
        if known is None or hand is None:
            raise PolicyError("the expert needs the simulator's state, and got none", cause="protocol")
        now = Pose(known.state.tcp, Rotation.from_matrix(known.state.tcp_rotation))
        aim = self._aim or now
        part = len(self.written) % self._parts
        if part == 0:
            (chunk,) = self._expert.act([replace(seen, step=len(self.written) // self._parts)])
            self._begun, self._way = aim, aim.move_to(now.moved(chunk.actions[0]))
            self._gripper = chunk.actions[0][6]
        waypoint = self._begun.moved(self._way * ((part + 1) / self._parts))
        origin = now if self.spec.action.relative_to == "current" else aim
        action = np.append(origin.move_to(waypoint), self._gripper)
        written = self._interface.written(action, hand)
        self.written.append(written)
        self._aim = origin.moved(self._interface.metric(written, hand))
        return ActionChunk(self._interface.answer(written, hand)[None])
