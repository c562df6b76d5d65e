"""Pinhole: the expert's controller behind a calibrated camera. It is fast: it needs physics, no renderer."""

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
from vlafuzz.rigs.rig import Rig, camera_pose
from vlafuzz.rigs.robots import rig

Array = NDArray[np.float64]
# Share of the offset between the hand's true and apparent position that is corrected. Set once, so that
# random pick-up scenes at the default ranges fail 20 to 40 % of the time.
CORRECTED = 0.62
RAISED = 0.42  # metres: a hand at this height hides no place on the table from the camera
GRIPPED = 0.004  # metres between the fingers above which something is held


class Pinhole:
    """A scripted controller that sees outlines through a camera which it assumes to be at its nominal pose.

    It is given no positions. It knows the shapes and colours of the catalogue, picks the outline whose colour
    and size are most like the named object's, estimates the stable pose and yaw from the outline, and locates
    it by back-projection through the nominal camera. It sees its own hand through the same camera and
    corrects a fixed share of the offset.

    So it fails for physical reasons: a displaced camera shifts what it reaches for; darkness and glare hide
    or confuse colours; other objects occlude, look alike or stand in the way, since it avoids nothing; an
    instruction that names the objects in another order makes it take the wrong one. It is deterministic.
    """

    def __init__(self) -> None:
        self.spec = PolicySpec(
            "pinhole", action=ActionSpec(relative_to="current"), silhouettes=True, state=True
        )
        self._models: tuple[ObjectModel, ...] | None = None
        self._episodes: dict[str, _Episode] = {}

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``. Of objects with the same spoken name, those of packs come first."""
        first = catalogue.preferred(catalogue.names())
        names = dict.fromkeys([*first, *catalogue.names()])
        self._models = tuple(catalogue[name] for name in names)

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        if self._models is None:
            self.know(load_catalogue())
        for start in episodes:
            self._episodes[start.episode] = _Episode(start.task, self._models or (), rig(start.robot))

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [
            ActionChunk(self._episodes[observation.episode].act(observation)[None])
            for observation in observations
        ]

    def close(self) -> None:
        self._episodes.clear()


class _Episode:
    """One rollout: look, act, and look again after a failed attempt."""

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
        targets = self._look(observation.instruction, outlines)
        if not targets:
            return np.array([0.0, 0.0, min(RAISED - tcp[2], 0.1), 0.0, 0.0, 0.0, 1.0])
        hand = self._localizer.hand(outlines, float(tcp[2]))
        if hand is not None:
            tcp[:2] += CORRECTED * (hand - tcp[:2])
        return self._controller.act(self._belief(targets, tcp, state))

    def _look(self, instruction: str, outlines: Outlines) -> list[Thing]:
        """The named objects where they were first seen in this attempt; those not seen yet are left out."""
        named = _named(instruction, self._models)
        things = {
            model.name: self._seen.get(model.name) or self._localizer.find(model, outlines) for model in named
        }
        if all(things.values()):
            self._seen = {name: thing for name, thing in things.items() if thing}
        return [self._seen[model.name] for model in named if model.name in self._seen]

    def _belief(self, targets: Sequence[Thing], tcp: Array, state: NDArray[np.float32]) -> Belief:
        angle = state[3:6].astype(np.float64)
        return Belief(
            a=targets[0],
            b=targets[1] if len(targets) > 1 else None,
            others=(),
            tcp=tcp,
            tcp_rotation=np.asarray(Rotation.from_rotvec(angle).as_matrix()),
            held=float(state[6]) * self._rig.opening > GRIPPED,
            done=True,
        )


def _named(instruction: str, models: Sequence[ObjectModel]) -> list[ObjectModel]:
    """The objects that an instruction names, in their order; of overlapping names, the longer one."""
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
