"""Pinhole: the expert's hands with a calibrated camera's eyes. The fast policy: it needs physics only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.errors import PolicyError
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.objects.model import ObjectModel
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, Outlines, PolicySpec
from vlafuzz.policies.outline_localizer import OutlineLocalizer
from vlafuzz.policies.pick_place import Belief, PickPlaceController
from vlafuzz.policies.planning import Thing
from vlafuzz.rigs.camera import camera_pose
from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import rig

Array = NDArray[np.float64]
# Share of the offset between where the hand is and where it seems to be that is corrected. Set once, so
# that random pick-up
# scenes at the default ranges fail 20 to 40 % of the time.
CORRECTED = 0.62
RAISED = 0.42  # metres; out of the camera's way to every place on the table
GRIPPED = 0.004  # metres between closed fingers from which on something is between them


class Pinhole:
    """A calibrated hand-eye system: looks through a camera that it believes to be in its place, then acts.

    It is told no positions. From outlines it takes place, main axis and standing or lying; it knows the
    catalogue's shapes
    and colours, takes the thing whose colour and size are nearest to the named object's, and places it by
    back-projection
    through the nominal camera. It sees its own hand through the same camera and corrects a fixed share of
    the offset.

    So it fails for physical reasons: a moved or turned camera shifts what it reaches for; darkness and
        glare hide or confuse
    colours; others occlude, look alike or stand in its way, since it avoids nothing; a wording that names
    the objects in
    another order makes it take the wrong one. It is deterministic.
    """

    def __init__(self) -> None:
        self.spec = PolicySpec(
            "pinhole", action=ActionSpec(relative_to="current"), silhouettes=True, state=True
        )
        self._models: tuple[ObjectModel, ...] | None = None
        self._episodes: dict[str, _Episode] = {}

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``. Of objects with the same spoken name it thinks of the packs' first."""
        first = catalogue.preferred(catalogue.names())
        names = dict.fromkeys([*first, *catalogue.names()])
        self._models = tuple(catalogue[name] for name in names)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts begin."""
        if self._models is None:
            self.know(load_catalogue())
        for start in episodes:
            self._episodes[start.episode] = _Episode(start.task, self._models or (), rig(start.robot))

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """One action each."""
        return [
            ActionChunk(self._episodes[observation.episode].act(observation)[None])
            for observation in observations
        ]

    def close(self) -> None:
        """No more rollouts."""
        self._episodes.clear()


class _Episode:
    """One rollout: look, act, look again after a failed attempt."""

    def __init__(self, task: str, models: Sequence[ObjectModel], rig: Rig) -> None:
        self._models, self._rig = models, rig
        self._localizer = OutlineLocalizer(camera_pose(rig.view))
        self._controller = PickPlaceController(task, rig)
        self._seen: dict[str, Thing] = {}
        self._attempt = 0

    def act(self, observation: Observation) -> Array:
        outlines, state = observation.outlines, observation.state
        if outlines is None or state is None:
            raise PolicyError("pinhole needs outlines and proprioception, and got none", cause="protocol")
        tcp = state[:3].astype(np.float64)
        if self._controller.attempt != self._attempt:
            self._attempt, self._seen = self._controller.attempt, {}
        found = self._look(observation.instruction, outlines)
        if not found:
            return np.array([0.0, 0.0, min(RAISED - tcp[2], 0.1), 0.0, 0.0, 0.0, 1.0])
        seen = self._localizer.hand(outlines, float(tcp[2]))
        if seen is not None:
            tcp[:2] += CORRECTED * (seen - tcp[:2])
        return self._controller.act(self._belief(found, tcp, state))

    def _look(self, instruction: str, outlines: Outlines) -> list[Thing]:
        """What the instruction names, as it was seen first; without what it names anew and is out of view."""
        named = _named(instruction, self._models)
        found = {
            each.name: self._seen.get(each.name) or self._localizer.find(each, outlines) for each in named
        }
        if all(found.values()):
            self._seen = {name: thing for name, thing in found.items() if thing}
        return [self._seen[each.name] for each in named if each.name in self._seen]

    def _belief(self, found: Sequence[Thing], tcp: Array, state: NDArray[np.float32]) -> Belief:
        angle = state[3:6].astype(np.float64)
        return Belief(
            a=found[0],
            b=found[1] if len(found) > 1 else None,
            others=(),
            tcp=tcp,
            tcp_rotation=np.asarray(Rotation.from_rotvec(angle).as_matrix()),
            held=float(state[6]) * self._rig.opening > GRIPPED,
            done=True,
        )


def _named(instruction: str, models: Sequence[ObjectModel]) -> list[ObjectModel]:
    """The objects that an instruction names, in its order; of two names that overlap the longer one."""
    text = instruction.lower()
    places = [
        (text.find(model.spoken), -len(model.spoken), model) for model in models if model.spoken in text
    ]
    named: list[ObjectModel] = []
    end = 0
    for start, length, model in sorted(places, key=lambda place: place[:2]):
        if start >= end:
            named.append(model)
            end = start - length
    return named
