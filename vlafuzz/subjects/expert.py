"""The expert: a scripted controller that knows the simulator's state. It shows that a scene can be solved."""

from __future__ import annotations

from collections.abc import Sequence

from vlafuzz.errors import SubjectError
from vlafuzz.robots import rig
from vlafuzz.subjects.base import ActionChunk, ActionSpec, EpisodeStart, Observation, Privileged, SubjectSpec
from vlafuzz.subjects.hands import Belief, Hands
from vlafuzz.subjects.planning import Thing
from vlafuzz.tasks.tabletop import task

GRASPS = 4
LEANS = (0.0, 0.3, -0.3)  # radians
ATTEMPTS = GRASPS * len(LEANS)


class Expert:
    """Plans its grasp from geometry and pose, checks it, tries again; keeps clear of everything else.

    Args:
        fluent: as ``Hands``: for demonstrations.

    Attributes:
        attempt: how rollouts begin: the first ``GRASPS`` are the best grasps from straight above, then the
            same with the hand leaning one way and the other.
    """

    def __init__(self, *, fluent: bool = False) -> None:
        self._fluent, self.attempt = fluent, 0
        self.spec = SubjectSpec("expert", action=ActionSpec(relative_to="current"), privileged=True)
        self._hands: dict[str, Hands | None] = {}
        self._tasks: dict[str, str] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts begin."""
        for episode in episodes:
            self._hands[episode.episode] = None
            self._tasks[episode.episode] = episode.task

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """One action each."""
        return [self._act(observation) for observation in observations]

    def close(self) -> None:
        """No more rollouts."""
        self._hands.clear()

    def _act(self, observation: Observation) -> ActionChunk:
        known = observation.privileged
        if known is None:
            raise SubjectError("the expert needs the simulator's state, and got none", cause="protocol")
        hands = self._hands.get(observation.episode)
        if hands is None:
            hands = self._hands[observation.episode] = Hands(
                self._tasks[observation.episode],
                rig(known.scene.robot),
                fluent=self._fluent,
                attempt=self.attempt % GRASPS,
                lean=LEANS[self.attempt // GRASPS],
            )
        return ActionChunk(hands.act(_belief(known))[None])


def _belief(known: Privileged) -> Belief:
    state = known.state
    things = [
        Thing(model, state.positions[index], state.rotations[index])
        for index, model in enumerate(known.models)
    ]
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
