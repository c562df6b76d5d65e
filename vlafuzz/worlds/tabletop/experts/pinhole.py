"""Pinhole: the expert's controller behind a calibrated camera. It is fast: it needs physics, no renderer."""

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionSpec, EpisodeStart, Observation, Outlines, PolicySpec
from vlafuzz.worlds.base import Acting, Scripted
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA, Rig, rig
from vlafuzz.worlds.manipulation.rotations import rotation_matrix
from vlafuzz.worlds.sight import CameraPose
from vlafuzz.worlds.tabletop.experts.pick_place import Belief, PickPlaceController
from vlafuzz.worlds.tabletop.experts.planning import Thing
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel, StablePose

# Share of the offset between the hand's true and apparent position that is corrected. Set once, so that
# random pick-up scenes at the default ranges fail 20 to 40 % of the time.
CORRECTED = 0.62
RAISED = 0.42  # metres: a hand at this height hides no place on the table from the camera
GRIPPED = 0.004  # metres between the fingers above which something is held
NOISE = 3 / 255  # a colour this close to the table's in every channel cannot be told from it
VISIBLE = 0.6  # an object of whose outline less is visible is not recognized
SIZE_WEIGHT = 0.25  # of an error in size by a factor of e, relative to an error of 1 in one colour channel
YAWS = np.radians(np.arange(0, 180, 15))
_TICKS = np.linspace(0.04, 0.96, 24)
_GRID = np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2)


class Pinhole(Scripted):
    """A scripted controller that sees outlines through a camera which it assumes to be at its nominal pose.

    It is given no positions. It knows the shapes and colours of the catalogue, picks the outline whose colour and size
    are most like the named object's, estimates the stable pose and yaw from the outline, and locates it by
    back-projection through the nominal camera. It sees its own hand through the same camera and corrects a fixed share
    of the offset.

    So it fails for physical reasons: a displaced camera shifts what it reaches for; darkness and glare hide or confuse
    colours; other objects occlude, look alike or stand in the way, since it avoids nothing; an instruction that names
    the objects in another order makes it take the wrong one. It is deterministic.
    """

    def __init__(self) -> None:
        action = ActionSpec(relative_to="current")
        super().__init__(PolicySpec("pinhole", action=action, silhouettes=True, state=True))

    def begin(self, start: EpisodeStart) -> Acting:
        # Of objects with the same spoken name, those of packs come first
        catalogue = start.catalogue or load_catalogue()
        names = catalogue.names()
        models = [catalogue[name] for name in dict.fromkeys([*catalogue.preferred(names), *names])]
        return _Episode(start.task, models, rig(start.robot or PANDA.robot)).act


def raised(tcp: Array) -> Array:
    """The action that raises the hand, out of the camera's view of the table."""
    return np.array([0.0, 0.0, min(RAISED - tcp[2], 0.1), 0.0, 0.0, 0.0, 1.0])


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
            return raised(tcp)
        hand = self._localizer.hand(outlines, float(tcp[2]))
        if hand is not None:
            tcp[:2] += CORRECTED * (hand - tcp[:2])
        belief = Belief(
            a=targets[0],
            b=targets[1] if len(targets) > 1 else None,
            others=(),
            tcp=tcp,
            tcp_rotation=Rotation.from_rotvec(state[3:6].astype(np.float64)).as_matrix(),
            held=float(state[6]) * self._rig.opening > GRIPPED,
            done=True,
        )
        return self._controller.act(belief)

    def _look(self, instruction: str, outlines: Outlines) -> list[Thing]:
        """The named objects where they were first seen in this attempt; those not seen yet are left out."""
        named = _named(instruction, self._models)
        things = {model.name: self._seen.get(model.name) or self._localizer.find(model, outlines) for model in named}
        if all(things.values()):
            self._seen = {name: thing for name, thing in things.items() if thing}
        return [self._seen[model.name] for model in named if model.name in self._seen]


def _named(instruction: str, models: Sequence[ObjectModel]) -> list[ObjectModel]:
    """The objects that an instruction names, in their order; of overlapping names, the longer one."""
    text = instruction.lower()
    places = [(text.find(model.spoken), -len(model.spoken), model) for model in models if model.spoken in text]
    named: list[ObjectModel] = []
    end = 0
    for start, length, model in sorted(places, key=lambda place: place[:2]):
        if start >= end:
            named.append(model)
            end = start - length
    return named


class OutlineLocalizer:
    """Assumes the camera at its nominal pose: when it is displaced, everything appears shifted."""

    def __init__(self, nominal: CameraPose) -> None:
        self._view = nominal

    def find(self, model: ObjectModel, outlines: Outlines) -> Thing | None:
        """The object at its apparent pose, matched to the most similar outline; None when none is visible."""
        best, least = None, np.inf
        for seen in outlines.things:
            contrast = np.abs(camera_values(seen.colour) - camera_values(outlines.table)).max()
            if seen.whole >= VISIBLE and contrast > NOISE:
                thing, size_ratio = self._pose(model, seen.pixels)
                colour = float(np.linalg.norm(camera_values(seen.colour) - model.colour))
                unlike = colour + SIZE_WEIGHT * abs(float(np.log(size_ratio)))
                if unlike < least:
                    best, least = thing, unlike
        return best

    def hand(self, outlines: Outlines, height: float) -> Array | None:
        """``(2,)`` apparent position of the hand, metres, at its known height; None when out of view."""
        if outlines.hand is None:
            return None
        return self._view.back_project(outlines.hand[None], height)[0, :2]

    def _pose(self, model: ObjectModel, pixels: Array) -> tuple[Thing, float]:
        """The object's pose if these are its pixels, and the ratio of their extent to the expected one.

        Rest pose and yaw are those whose outline has the most similar covariance; the position is where the ray through
        the mean pixel meets the plane at half the object's height.
        """
        seen = np.cov(pixels.T)
        best, best_error, best_ratio = None, np.inf, 1.0
        for pose in model.stable_poses:
            place = self._view.back_project(pixels.mean(axis=0)[None], pose.top / 2)[0, :2]
            for yaw in YAWS:
                thing = standing(model, pose, place, yaw)
                expected = np.cov(self._interior(thing).T)
                error = float(np.abs(seen - expected).sum() / np.trace(expected))
                if error < best_error:
                    best, best_error = thing, error
                    best_ratio = float(np.sqrt(np.linalg.det(seen) / np.linalg.det(expected)))
        assert best is not None
        return self._centred(best, pixels), best_ratio

    def _centred(self, thing: Thing, pixels: Array) -> Thing:
        """The object moved so that the mean of its outline coincides with the mean of the pixels."""
        height = float(thing.position[2])
        middles = np.stack([pixels.mean(axis=0), self._interior(thing).mean(axis=0)])
        seen, expected = self._view.back_project(middles, height)
        shift = np.append((seen - expected)[:2], 0.0)
        return Thing(thing.model, thing.position + shift, thing.rotation)

    def _interior(self, thing: Thing) -> Array:
        """``(k, 2)`` points that evenly fill the outline."""
        uv, _ = self._view.project(thing.corners)
        return _fill(np.asarray(cv2.convexHull(uv.astype(np.float32))[:, 0], dtype=np.float64))


def camera_values(colour: Array) -> Array:
    return np.asarray(np.round(colour * 255) / 255)


def standing(model: ObjectModel, pose: StablePose, place: Array, yaw: float) -> Thing:
    """An object in a stable pose on the table at ``place`` (2,), metres."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return Thing(model, np.array([*place, pose.height]), turn @ rotation_matrix(pose.quaternion))


def _fill(hull: Array) -> Array:
    """The points of a regular grid over the bounding box of a convex polygon that lie inside it."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    points = low + _GRID * (high - low)
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    side = points @ normals.T - np.einsum("ij,ij->i", hull, normals)
    inside = np.all(side <= 0, axis=1) | np.all(side >= 0, axis=1)
    return np.asarray(points[inside])
