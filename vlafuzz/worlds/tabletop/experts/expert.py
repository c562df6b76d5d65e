"""The expert, a scripted controller on the simulator's state that shows that a scene can be solved.

Here is also what experts are told beside pictures: the ground truth, or how to read a picture.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import PolicyError
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.manipulation.camera import CameraPose
from vlafuzz.worlds.manipulation.rigs import PANDA, rig
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.state import State
from vlafuzz.worlds.tabletop.tasks import task

Acting = Callable[[Observation], NDArray[np.float64]]  # gives actions (7,)


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


class Scripted(ABC):
    """A policy that is a script, which acts in each rollout by itself."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec
        self._acting: dict[str, Acting] = {}
        self._catalogue: Catalogue | None = None

    @abstractmethod
    def begin(self, start: EpisodeStart) -> Acting:
        """What acts in a rollout that begins."""

    @property
    def catalogue(self) -> Catalogue:
        if self._catalogue is None:
            self._catalogue = load_catalogue()
        return self._catalogue

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``."""
        self._catalogue = catalogue

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for start in episodes:
            self._acting[start.episode] = self.begin(start)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._acting[seen.episode](seen)[None]) for seen in observations]

    def close(self) -> None:
        self._acting.clear()


GRASPS = 4
LEANS = (0.0, 0.3, -0.3)  # radians
ATTEMPTS = GRASPS * len(LEANS)


def controller(start: EpisodeStart, attempt: int, *, fluent: bool = False) -> PickPlaceController:
    """A controller whose first grasp is that of an attempt.

    The attempts are the ``GRASPS`` best grasps from straight above, then the same with the hand leaning one way, then
    the other way.
    """
    lean = LEANS[attempt // GRASPS]
    return PickPlaceController(
        start.task, rig(start.robot or PANDA.robot), fluent=fluent, attempt=attempt % GRASPS, lean=lean
    )


class Expert(Scripted):
    """A scripted controller that reads the simulator's state: it plans grasps, avoids obstacles and retries.

    ``attempt``: of the next rollouts, see ``controller``. ``fluent``: see ``PickPlaceController``; for demonstrations.
    """

    def __init__(self, *, fluent: bool = False) -> None:
        super().__init__(PolicySpec("expert", action=ActionSpec(relative_to="current"), privileged=True))
        self._fluent, self.attempt = fluent, 0

    def begin(self, start: EpisodeStart) -> Acting:
        chosen = controller(start, self.attempt, fluent=self._fluent)
        return lambda seen: chosen.act(_belief(seen.privileged))


def _belief(known: object) -> Belief:
    if not isinstance(known, Privileged):
        raise PolicyError("the expert needs the simulator's state, and got none", cause="protocol")
    state = known.state
    things = list(map(Thing, known.models, state.positions, state.rotations))
    targets = task(known.scene.task).targets
    return Belief(
        a=things[0],
        b=things[1] if targets == 2 else None,
        others=tuple(things[targets:]),
        tcp=state.tcp,
        tcp_rotation=state.tcp_rotation,
        held=state.held == 0,
        done=known.done,
    )
