"""The expert, a scripted controller on the simulator's state that shows that a scene can be solved.

Here is also what experts are told beside pictures: the ground truth, or how to read a picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.model import Scene
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.clients.model import Interface, Written
from vlafuzz.worlds.base import Acting, Scripted
from vlafuzz.worlds.manipulation.rigs import PANDA, rig
from vlafuzz.worlds.sight import CameraPose
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.tasks import State, task


@dataclass(frozen=True, eq=False)
class Privileged:
    """Ground truth, for experts only. ``done``: the success condition holds in this step."""

    scene: Scene
    models: tuple[ObjectModel, ...]
    state: State
    done: bool = False


@dataclass(frozen=True, eq=False)
class Calibration:
    """How to read a picture: the camera's true pose, the factor on all lights, and what the targets are."""

    view: CameraPose
    light: float
    targets: tuple[ObjectModel, ...]


GRASPS = 4
LEANS = (0.0, 0.3, -0.3)  # radians
ATTEMPTS = GRASPS * len(LEANS)


def controller(start: EpisodeStart, attempt: int, *, fluent: bool = False) -> PickPlaceController:
    """A controller whose first grasp is that of an attempt.

    The attempts are the ``GRASPS`` best grasps from straight above, then the same with the hand leaning one way, then
    the other way.
    """
    lean, setup = LEANS[attempt // GRASPS], rig(start.robot or PANDA.robot)
    return PickPlaceController(start.task, setup, fluent=fluent, attempt=attempt % GRASPS, lean=lean)


class Expert(Scripted):
    """A scripted controller that reads the simulator's state: it plans grasps, avoids obstacles and retries.

    ``attempt``: of the next rollouts, see ``controller``. ``fluent``: see ``PickPlaceController``; for demonstrations.
    """

    def __init__(self, *, fluent: bool = False) -> None:
        super().__init__(PolicySpec("expert", action=ActionSpec(relative_to="current"), privileged=True))
        self._fluent, self.attempt = fluent, 0

    def begin(self, start: EpisodeStart) -> Acting:
        chosen = controller(start, self.attempt, fluent=self._fluent)
        return lambda seen: chosen.act(belief(seen.privileged))


def belief(known: object) -> Belief:
    if not isinstance(known, Privileged):
        raise PolicyError("the expert needs the simulator's state, and got none", cause="protocol")
    state = known.state
    things = list(map(Thing, known.models, state.positions, state.rotations))
    targets = task(known.scene.task).targets
    return Belief(
        a=things[0],
        b=things[1] if targets == 2 else None,
        others=tuple(things[index] for index in state.there if index >= targets),
        tcp=state.tcp,
        tcp_rotation=state.tcp_rotation,
        held=state.held == 0,
        done=known.done,
    )


class Pose(NamedTuple):
    """A pose of the hand: ``place`` (3,) in metres."""

    place: Array
    turn: Rotation

    def moved(self, move: Array) -> "Pose":
        """The pose after a move ``(6,)``: metres, and a rotation vector about the base's axes."""
        return Pose(self.place + move[:3], Rotation.from_rotvec(move[3:6]) * self.turn)

    def move_to(self, other: "Pose") -> Array:
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
        known = seen.privileged
        if known is None:
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
        written = self._interface.written(action)
        self.written.append(written)
        self._aim = origin.moved(self._interface.metric(written))
        return ActionChunk(written[None].astype(np.float64))
