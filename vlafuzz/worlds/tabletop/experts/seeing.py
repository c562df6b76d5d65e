"""The seeing expert: the expert's controller on what the camera shows, through its true calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import (
    ActionChunk,
    ActionSpec,
    EpisodeStart,
    Observation,
    PolicySpec,
)
from vlafuzz.worlds.manipulation.rigs.hand import hand_boxes
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.experts.expert import GRASPS, LEANS
from vlafuzz.worlds.tabletop.experts.fitting import Look
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.pinhole import GRIPPED, RAISED
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

Array = NDArray[np.float64]
GONE = 0.07  # share of an object's outline in which the table is seen, above which the object has moved


class SeeingExpert:
    """A scripted controller that sees outlines through the true camera and knows the light, but no positions.

    It shows that a scene can be solved by what the camera shows. It knows which objects are the targets and
    the catalogue's shapes and colours, finds objects by their apparent colour and fits their poses to their
    outlines, avoids the others as the ``Expert`` does, and looks again for what is no longer where it was.

    ``attempt``: see ``Expert``.
    """

    def __init__(self) -> None:
        self.attempt = 0
        action = ActionSpec(relative_to="current")
        self.spec = PolicySpec("seeing", action=action, silhouettes=True, state=True, calibrated=True)
        self._models: tuple[ObjectModel, ...] | None = None
        self._episodes: dict[str, _Episode] = {}

    def know(self, catalogue: Catalogue) -> None:
        """See ``Knowing``."""
        self._models = tuple(catalogue[name] for name in catalogue.names())

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        if self._models is None:
            self.know(load_catalogue())
        for start in episodes:
            self._episodes[start.episode] = _Episode(start, self._models or (), self.attempt)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._episodes[seen.episode].act(seen)[None]) for seen in observations]

    def close(self) -> None:
        self._episodes.clear()


class _Episode:
    """One rollout: act on where things were last seen, and look for what is no longer there."""

    def __init__(self, start: EpisodeStart, models: Sequence[ObjectModel], attempt: int) -> None:
        self._models, self._rig = models, rig(start.robot)
        lean = LEANS[attempt // GRASPS]
        self._controller = PickPlaceController(start.task, self._rig, attempt=attempt % GRASPS, lean=lean)
        self._targets: dict[int, Thing] = {}  # by their number in the instruction
        self._others: tuple[Thing, ...] = ()
        self._surveyed = (-1, 0)
        self._closed = False

    def act(self, observation: Observation) -> Array:
        outlines, state, calibration = observation.outlines, observation.state, observation.calibration
        if outlines is None or state is None or calibration is None:
            raise PolicyError("seeing needs outlines, proprioception and calibration", cause="protocol")
        tcp = state[:3].astype(np.float64)
        rotation = np.asarray(Rotation.from_rotvec(state[3:6].astype(np.float64)).as_matrix())
        opening = float(state[6]) * self._rig.opening
        look = Look(outlines, calibration, hand_boxes(tcp, rotation, opening))
        self._track(look, calibration.targets)
        self._survey(look)
        if len(self._targets) < len(calibration.targets):
            return np.array([0.0, 0.0, min(RAISED - tcp[2], 0.1), 0.0, 0.0, 0.0, 1.0])
        belief = Belief(
            a=self._targets[0],
            b=self._targets.get(1),
            others=self._others,
            tcp=tcp,
            tcp_rotation=rotation,
            held=opening > GRIPPED,
        )
        action = self._controller.act(belief)
        self._closed = bool(action[6] < 0)
        return action

    def _track(self, look: Look, models: Sequence[ObjectModel]) -> None:
        """Update the targets that are not where they were. What the hand holds moves with it."""
        for number, model in enumerate(models):
            known = self._targets.get(number)
            if (number == 0 and self._closed) or (known and look.bare(known) < GONE):
                continue
            rest = [thing for target, thing in self._targets.items() if target != number]
            thing = look.find(model, look.alike(model, look.besides([*rest, *self._others])))
            if thing:
                self._targets[number] = thing

    def _survey(self, look: Look) -> None:
        """Identify the other objects by colour and shape, in every attempt and when there is more to see."""
        now = (self._controller.attempt, len(look.colours))
        if self._closed or now <= self._surveyed:
            return
        self._surveyed = now
        labels = look.besides(self._targets.values())
        likely = {model: look.alike(model, labels) for model in self._models}
        models = {label: [model for model in likely if label in likely[model]] for label in labels}
        self._others = tuple(look.recognize(models[label], label) for label in labels if models[label])
