"""The expert, a scripted controller on the simulator's state that shows that a scene can be solved.

Here is also what experts are told beside pictures: the ground truth, or how to read a picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from vlafuzz.errors import PolicyError
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.worlds.manipulation.rigs.camera import CameraPose
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.state import State
from vlafuzz.worlds.tabletop.tasks import task


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


class Expert:
    """A scripted controller that reads the simulator's state: it plans grasps, avoids obstacles and retries.

    ``attempt``: index of the first grasp of a rollout: the ``GRASPS`` best grasps from straight above, then
    the same grasps with the hand leaning one way, then the other way. ``fluent``: see
    ``PickPlaceController``; for demonstrations.
    """

    def __init__(self, *, fluent: bool = False) -> None:
        self._fluent, self.attempt = fluent, 0
        self.spec = PolicySpec("expert", action=ActionSpec(relative_to="current"), privileged=True)
        self._controllers: dict[str, PickPlaceController] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        for start in episodes:
            attempt, lean = self.attempt % GRASPS, LEANS[self.attempt // GRASPS]
            self._controllers[start.episode] = PickPlaceController(
                start.task, rig(start.robot), fluent=self._fluent, attempt=attempt, lean=lean
            )

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [self._act(observation) for observation in observations]

    def close(self) -> None:
        self._controllers.clear()

    def _act(self, observation: Observation) -> ActionChunk:
        known = observation.privileged
        if not isinstance(known, Privileged):
            raise PolicyError("the expert needs the simulator's state, and got none", cause="protocol")
        return ActionChunk(self._controllers[observation.episode].act(_belief(known))[None])


def _belief(known: Privileged) -> Belief:
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
