"""Outline localizer: estimates an object's pose from outlines in the view of a calibrated camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.objects.model import ObjectModel, StablePose, rotation_matrix
from vlafuzz.policies.base import Outlines, Silhouette
from vlafuzz.policies.planning import Thing
from vlafuzz.rigs.rig import CameraPose

Array = NDArray[np.float64]
NOISE = 3 / 255  # a colour this close to the table's in every channel cannot be told from it
VISIBLE = 0.6  # an object of whose outline less is visible is not recognized
SIZE_WEIGHT = 0.25  # of an error in size by a factor of e, relative to an error of 1 in one colour channel
YAWS = np.radians(np.arange(0, 180, 15))


class OutlineLocalizer:
    """Assumes the camera at its nominal pose: when it is displaced, everything appears shifted."""

    def __init__(self, nominal: CameraPose) -> None:
        self._view = nominal

    def find(self, model: ObjectModel, outlines: Outlines) -> Thing | None:
        """The object at its apparent pose, matched to the most similar outline; None when none is visible."""
        visible = [thing for thing in outlines.things if self._sees(thing, outlines.table)]
        if not visible:
            return None
        guesses = [(thing, *self._pose(model, thing.pixels)) for thing in visible]
        _, placed, _ = min(guesses, key=lambda guess: self._unlikeness(model, guess[0], guess[2]))
        return placed

    def hand(self, outlines: Outlines, height: float) -> Array | None:
        """``(2,)`` apparent position of the hand, metres, at its known height; None when out of view."""
        if outlines.hand is None:
            return None
        return self._view.back_project(outlines.hand[None], height)[0, :2]

    def _sees(self, thing: Silhouette, table: Array) -> bool:
        contrast = np.abs(_camera_values(thing.colour) - _camera_values(table)).max()
        return thing.whole >= VISIBLE and bool(contrast > NOISE)

    def _unlikeness(self, model: ObjectModel, thing: Silhouette, size_ratio: float) -> float:
        colour = float(np.linalg.norm(_camera_values(thing.colour) - model.colour))
        return colour + SIZE_WEIGHT * abs(float(np.log(size_ratio)))

    def _pose(self, model: ObjectModel, pixels: Array) -> tuple[Thing, float]:
        """The object's pose if these are its pixels, and the ratio of their extent to the expected one.

        Rest pose and yaw are those whose outline has the most similar covariance; the position is where the
        ray through the mean pixel meets the plane at half the object's height.
        """
        seen = _spread(pixels)
        best, best_error, best_ratio = None, np.inf, 1.0
        for pose in model.stable_poses:
            place = self._view.back_project(pixels.mean(axis=0)[None], pose.top / 2)[0, :2]
            for yaw in YAWS:
                thing = _standing(model, pose, place, yaw)
                expected = _spread(self._interior(thing))
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
        return _fill(_hull(uv))


def _camera_values(colour: Array) -> Array:
    return np.asarray(np.round(colour * 255) / 255)


def _standing(model: ObjectModel, pose: StablePose, place: Array, yaw: float) -> Thing:
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return Thing(model, np.array([*place, pose.height]), turn @ rotation_matrix(pose.quaternion))


def _spread(points: Array) -> Array:
    return np.asarray(np.cov(points.T))


def _hull(points: Array) -> Array:
    return np.asarray(cv2.convexHull(points.astype(np.float32))[:, 0], dtype=np.float64)


_TICKS = np.linspace(0.04, 0.96, 24)
_GRID = np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2)


def _fill(hull: Array) -> Array:
    """The points of a regular grid over the bounding box of a convex polygon that lie inside it."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    points = low + _GRID * (high - low)
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    side = points @ normals.T - np.einsum("ij,ij->i", hull, normals)
    inside = np.all(side <= 0, axis=1) | np.all(side >= 0, axis=1)
    return np.asarray(points[inside])
