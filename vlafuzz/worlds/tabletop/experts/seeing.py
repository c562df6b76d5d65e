"""The seeing expert: it fits the poses of known objects to the outlines that its calibrated camera shows."""

from collections.abc import Iterable, Sequence
from itertools import product
from operator import attrgetter
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionSpec, EpisodeStart, Observation, Outlines, PolicySpec
from vlafuzz.worlds.base import Acting, Scripted
from vlafuzz.worlds.manipulation.arms import hand_boxes
from vlafuzz.worlds.manipulation.camera import SUBPIXEL, blank, fill, paint, polygons
from vlafuzz.worlds.manipulation.rigs import PANDA, Rig, rig
from vlafuzz.worlds.tabletop.experts.expert import Calibration, controller
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.pinhole import GRIPPED, NOISE, camera_values, raised, standing
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel, StablePose

HAND = 255  # label; outlines are counted from 1, 0 is the background
LEAST = 12  # pixels of an outline that can be recognized
SAME = 0.5  # agreement from which on an outline is of an object
YAWS = np.radians(np.arange(0, 360, 30))
# To all sides by metres, and around by radians
STEPS = [np.array(s) * [0.032, 0.032, np.radians(24)] for s in product((-1, 0, 1), repeat=3) if any(s)]
HALVINGS = 7  # of the steps
STARTS = 3  # yaws of a pose that are refined, at most
GOOD = 0.98  # agreement above which no better pose is looked for


class Guess(NamedTuple):
    """An object in a stable pose on the table.

    ``shift``: x and y, metres, and yaw, radians. ``agreement``: with an outline, in [0, 1].
    """

    model: ObjectModel
    pose: StablePose
    shift: Array
    agreement: float = 0.0

    @property
    def thing(self) -> Thing:
        return standing(self.model, self.pose, self.shift[:2], self.shift[2])

    def moved(self, by: Array) -> Self:
        return self._replace(shift=self.shift + by)


agreement = attrgetter("agreement")


class Look:
    """One picture, read through a calibrated camera. ``hand``: boxes ``(8, 3)``, which hide what is behind.

    Whether outlines can be told from the table is not asked: for the targets, validity has checked it.

    Attributes:
        colours: apparent colours by label of the outlines that are large enough.
    """

    def __init__(self, outlines: Outlines, calibration: Calibration, hand: Sequence[Array]) -> None:
        self._view, self._light = calibration.view, calibration.light
        self._labels, self._painted = blank(self._view), blank(self._view)
        paint(self._labels, hand, self._view, HAND)
        self.colours: dict[int, Array] = {}
        for label, thing in enumerate(outlines.things, 1):
            if len(thing.pixels) >= LEAST:
                u, v = (thing.pixels * self._labels.shape[::-1]).astype(int).T
                self._labels[v, u] = label
                self.colours[label] = camera_values(thing.colour)
        self._sizes = np.bincount(self._labels.ravel(), minlength=HAND + 1)

    def besides(self, things: Iterable[Thing]) -> list[int]:
        """The labels of the outlines that are of no known thing."""
        known = list(things)
        return [n for n in self.colours if all(self.agreement(thing, n) < SAME for thing in known)]

    def alike(self, model: ObjectModel, labels: Iterable[int]) -> list[int]:
        """Select the outlines that are most like an object in colour; none if none has its colour."""
        apparent = camera_values(np.minimum(model.colour * self._light, 1.0))
        apart = {label: float(np.abs(self.colours[label] - apparent).max()) for label in labels}
        nearest = min([NOISE, *apart.values()])
        return [label for label, difference in apart.items() if difference <= nearest]

    def agreement(self, thing: Thing, label: int) -> float:
        """Intersection over union of an object and an outline, where nothing else hides the object."""
        under = self._under(thing)
        return float(under[label] / max(self._sizes[label] + under[0], 1))

    def bare(self, thing: Thing) -> float:
        """Share of an object's outline in which the table is seen instead."""
        under = self._under(thing)
        return float(under[0] / max(under.sum(), 1))

    def find(self, model: ObjectModel, labels: Iterable[int]) -> Thing | None:
        """An object in the pose in which it agrees best with one of some outlines; None without any."""
        best = None
        for label in sorted(labels, key=lambda n: self._start([model], n).agreement, reverse=True):
            best = max(filter(None, [best, self._fit(model, label)]), key=agreement)
            if best.agreement > GOOD:
                break
        return best.thing if best else None

    def recognize(self, models: Sequence[ObjectModel], label: int) -> Thing:
        """Which of some objects an outline is most like, and its pose, less surely than with ``find``."""
        return self._refine(self._start(models, label), label).thing

    def _fit(self, model: ObjectModel, label: int) -> Guess:
        """The best pose of all; of several that agree well, the first."""
        fits = []
        for pose in model.stable_poses:
            for start in self._starts(model, pose, label)[:STARTS]:
                fits.append(self._refine(start, label))
                if fits[-1].agreement > GOOD:
                    return fits[-1]
        return max(fits, key=agreement)

    def _start(self, models: Sequence[ObjectModel], label: int) -> Guess:
        poses = ((model, pose) for model in models for pose in model.stable_poses)
        return max((self._starts(*pair, label)[0] for pair in poses), key=agreement)

    def _starts(self, model: ObjectModel, pose: StablePose, label: int) -> list[Guess]:
        """The object where the outline is, in all directions, the best first."""
        guesses = (Guess(model, pose, np.array([0.0, 0.0, yaw])) for yaw in YAWS)
        rated = (self._rate(self._centred(guess, label), label) for guess in guesses)
        return sorted(rated, key=agreement, reverse=True)

    def _rate(self, guess: Guess, label: int) -> Guess:
        return guess._replace(agreement=self.agreement(guess.thing, label))

    def _centred(self, guess: Guess, label: int) -> Guess:
        """The object moved so that the middles of the two outlines coincide."""
        height = guess.pose.height
        v, u = np.nonzero(self._labels == label)
        seen = (np.array([[u.mean(), v.mean()]]) + 0.5) / self._labels.shape[::-1]
        place = self._view.back_project(seen, height)[0] * [1, 1, 0]
        guess = guess.moved(place)
        uv, _ = self._view.project(guess.thing.corners)
        middle = (uv.min(axis=0) + uv.max(axis=0))[None] / 2
        return guess.moved(place - self._view.back_project(middle, height)[0] * [1, 1, 0])

    def _refine(self, fit: Guess, label: int) -> Guess:
        """Move and turn a guess as long as it agrees better, by ever smaller steps."""
        halved = 0
        while halved < HALVINGS and fit.agreement <= GOOD:
            tries = (self._rate(fit.moved(step / 2**halved), label) for step in STEPS)
            better = next((tried for tried in tries if tried.agreement > fit.agreement), None)
            fit, halved = better or fit, halved + (better is None)
        return fit

    def _under(self, thing: Thing) -> NDArray[np.intp]:
        """Number of pixels of each label within an object's outline."""
        parts = [part @ thing.rotation.T + thing.position for part in thing.model.parts]
        outlines = polygons(parts, self._view)
        fill(self._painted, outlines, 1)
        corners = np.concatenate(outlines).reshape(-1, 2) // 2**SUBPIXEL
        left, top, right, bottom = np.maximum([*corners.min(axis=0), *corners.max(axis=0) + 2], 0)
        box = slice(top, bottom), slice(left, right)
        under = np.bincount(self._labels[box][self._painted[box] > 0], minlength=HAND + 1)
        self._painted[box] = 0
        return under


GONE = 0.07  # share of an object's outline in which the table is seen, above which the object has moved


class SeeingExpert(Scripted):
    """A scripted controller that sees outlines through the true camera and knows the light, but no positions.

    It shows that a scene can be solved by what the camera shows. It knows which objects are the targets and the
    catalogue's shapes and colours, finds objects by their apparent colour and fits their poses to their outlines,
    avoids the others as the ``Expert`` does, and looks again for what is no longer where it was.

    ``attempt``: see ``Expert``.
    """

    def __init__(self) -> None:
        action = ActionSpec(relative_to="current")
        super().__init__(PolicySpec("seeing", action=action, silhouettes=True, state=True, calibrated=True))
        self.attempt = 0

    def begin(self, start: EpisodeStart) -> Acting:
        catalogue = start.catalogue or load_catalogue()
        models = [catalogue[name] for name in catalogue]
        return _Episode(models, rig(start.robot or PANDA.robot), controller(start, self.attempt)).act


class _Episode:
    """One rollout: act on where things were last seen, and look for what is no longer there."""

    def __init__(self, models: Sequence[ObjectModel], rig: Rig, controller: PickPlaceController) -> None:
        self._models, self._rig, self._controller = models, rig, controller
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
            return raised(tcp)
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
