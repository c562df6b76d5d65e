"""Whether a person could see the targets in the policy's first picture."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array
from vlafuzz.model import Scene
from vlafuzz.worlds.manipulation import arms
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.camera import Labels, area_beyond, blank, camera_pose, exposed, fill, polygons
from vlafuzz.worlds.manipulation.looks import FLOOR_COLOUR, PAINTS, UP, glossy, shown, tones
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.fairness.footprint import pose_of
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.hulls import triangles
from vlafuzz.worlds.tabletop.objects.model import ROUGH, SRGB, ObjectModel

ROBOT = 255  # label; objects are counted from 1, 0 is the background
ROBOT_COLOUR = (0.80, 0.81, 0.82)  # linear, on average
REACH = 3  # the surroundings end so many pixels beyond an outline
RING = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
POINTS = 400  # of an object's surface, of which the camera sees less than half


@dataclass(frozen=True, eq=False)
class Skin:
    """A sample of an object's surface: points that stand for equal areas, in the object's frame."""

    points: Array  # (n, 3) metres
    normals: Array  # (n, 3) outwards
    colours: Array  # (n, 3) linear
    roughness: float  # in [0, 1]


@lru_cache(maxsize=256)
def skin(model: ObjectModel) -> Skin:
    """The skin of an object: of its textured mesh, else of its convex parts in the dominant colour."""
    if model.visual.suffix == ".glb" and model.fit is None:
        return _textured(model)
    corners = np.concatenate([part[triangles(part)] for part in model.parts])
    points, face, _ = _spread(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    textured = model.visual.name.startswith("textured")  # their mean is sRGB, a plain colour linear
    colour = model.colour**SRGB if textured else model.colour
    return Skin(points, normals, np.tile(colour, (len(points), 1)), ROUGH)


def textured(file: Path) -> tuple[Any, NDArray[np.uint8]]:
    """A mesh and its texture ``(height, width, 3)``, which take 40 ms to read."""
    import trimesh  # only for objects that are built in

    mesh: Any = trimesh.load_scene(file).to_geometry()
    return mesh, np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))


def _textured(model: ObjectModel) -> Skin:
    mesh, texture = textured(model.visual)
    points, face, weights = _spread(mesh.vertices[mesh.faces])
    corners = mesh.faces[face]
    normals = (mesh.vertex_normals[corners] * weights[..., None]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    u, v = (mesh.visual.uv[corners] * weights[..., None]).sum(axis=1).T
    height, width = texture.shape[:2]
    row, column = ((1 - v) * height).astype(int) % height, (u * width).astype(int) % width
    return Skin(points, normals, (texture[row, column] / 255) ** SRGB, mesh.visual.material.roughnessFactor)


def _spread(corners: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """Points spread evenly over triangles ``(n, 3, 3)``: the points, their triangles, barycentric weights."""
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.cumsum(np.linalg.norm(sides, axis=1))
    rng = np.random.default_rng(0)
    ticks = (np.arange(POINTS) + rng.random(POINTS)) / POINTS  # stratified: every face gets its share
    face = np.minimum(np.searchsorted(areas, ticks * areas[-1]), len(areas) - 1)
    a, b = np.sqrt(rng.random(POINTS)), rng.random(POINTS)
    weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
    return (corners[face] * weights[..., None]).sum(axis=1), face, weights


@dataclass(frozen=True)
class Hidden:
    """The visible share of an object's outline, and what hides most of the rest."""

    inside: float  # share of the outline
    unhidden: float  # share of the outline inside
    area: float  # share of the picture
    size: float  # square root of the outline's area, pixels of a picture ``labels.WIDTH`` wide
    by: str


class Picture:
    """The picture of a scene whose objects are all in the catalogue."""

    def __init__(self, scene: Scene, catalogue: Catalogue) -> None:
        self._scene, self._rig = exposed(scene), rig(scene.robot)
        self._view = camera_pose(self._rig.view, scene.camera)
        self._models = [catalogue[placement.object].scaled(placement.scale) for placement in scene.placements]
        self._poses = [pose_of(*pair) for pair in zip(scene.placements, self._models, strict=True)]
        self._parts = [
            [part @ turn.T + place for part in model.parts]
            for model, (turn, place) in zip(self._models, self._poses, strict=True)
        ]
        self._labels = self._painted()
        self._colours: dict[int, tuple[Array, Array]] = {}

    def place(self, index: int) -> Array:
        """Where an object's centre appears: right and down from the corner, pixels of a picture ``WIDTH`` wide."""
        uv, _ = self._view.project(self._poses[index][1][None])
        height, width = self._labels.shape
        return np.asarray(uv[0] * [width, height])

    def seems(self, index: int) -> Array:
        """``(2, 2)`` where an object seems to be by the usual camera, and where it is: metres from that one."""
        usual, place = camera_pose(self._rig.view), self._poses[index][1]
        seen = usual.back_project(self._view.project(place[None])[0], place[2])
        return (np.stack([seen[0], place]) - usual.position)[:, :2]

    def _painted(self) -> Labels:
        robot = [[body] for body in arms.bodies(self._rig, self._scene.initial_pose)]
        bodies = [*self._parts, *robot]
        drawn = iter(polygons([part for parts in bodies for part in parts], self._view))
        outlines = [[next(drawn) for _ in parts] for parts in bodies]
        middles = np.array([np.concatenate(parts).mean(axis=0) for parts in bodies])
        labels, self._outlines = blank(self._view), outlines[: len(self._parts)]
        for index in np.argsort((self._view.position - middles) @ self._view.axes[0], kind="stable").tolist():
            fill(labels, outlines[index], index + 1 if index < len(self._parts) else ROBOT)
        return labels

    def hidden(self, index: int) -> Hidden:
        alone, label = blank(self._view), index + 1
        fill(alone, self._outlines[index], 1)
        hiding = np.bincount(self._labels[alone > 0], minlength=256)
        inside, area = int(hiding.sum()), int(hiding[label])
        hiding[label] = 0
        whole = max(area_beyond(self._parts[index], self._view), inside, 1)
        by = self._name(int(hiding.argmax()))
        return Hidden(inside / whole, area / max(inside, 1), area / alone.size, math.sqrt(whole), by)

    def apart(self, index: int, least: float) -> tuple[float, str]:
        """The difference in grey levels between an object and what half of its outline borders on.

        A share ``least`` of what is seen of it differs by more from all shades around.
        """
        colours, areas = self.colours(index)
        if not len(colours):
            return 0.0, "what is around it"
        around, passed = list(self._surroundings(index)), 0
        total = sum(count for *_, count in around)
        differences = [(_difference(colours, areas, shades, least), name, count) for name, shades, count in around]
        for difference, name, count in sorted(differences):
            passed += count
            if passed >= total / 2:
                return difference, name
        return 255.0, "nothing"

    def colours(self, index: int) -> tuple[Array, Array]:
        """Pixel values ``(n, 3)`` at points that the camera sees of an object, and their relative areas."""
        if index not in self._colours:
            self._colours[index] = self._seen(index)
        return self._colours[index]

    def _seen(self, index: int) -> tuple[Array, Array]:
        look, (turn, place) = skin(self._models[index]), self._poses[index]
        points, normals = look.points @ turn.T + place, look.normals @ turn.T
        rays = self._view.position - points
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        facing = np.einsum("nc,nc->n", rays, normals)
        uv, _ = self._view.project(points)
        height, width = self._labels.shape
        u, v = np.clip((uv * [width, height]).astype(int), 0, [width - 1, height - 1]).T
        seen = (facing > 0) & (self._labels[v, u] == index + 1)
        normals, lights = normals[seen], self._rig.lights
        gloss = glossy(normals, rays[seen], look.roughness, lights)
        return shown(look.colours[seen], normals, lights, self._scene.light.intensity, gloss), facing[seen]

    def _name(self, label: int) -> str:
        return "the robot" if label == ROBOT else self._models[label - 1].spoken

    def _surroundings(self, index: int) -> Iterator[tuple[str, Array, int]]:
        """Yield what borders on an object: name, ``(k, 3)`` pixel values, and along how many pixels."""
        uv, _ = self._view.project(np.concatenate(self._parts[index]))
        height, width = self._labels.shape
        low, high = uv.min(axis=0) * [width, height] - REACH, uv.max(axis=0) * [width, height] + REACH
        left, top = np.maximum(low, 0).astype(int)
        near = self._labels[top : max(int(high[1]) + 1, 0), left : max(int(high[0]) + 1, 0)]
        seen = near == index + 1
        ring = (cv2.dilate(seen.astype(np.uint8), RING) > 0) & ~seen
        counts = np.bincount(near[ring], minlength=256)
        for label in (np.flatnonzero(counts[1:]) + 1).tolist():
            albedo = ROBOT_COLOUR if label == ROBOT else skin(self._models[label - 1]).colours.mean(axis=0)
            yield self._name(label), self._lit(albedo), int(counts[label])
        if counts[0]:
            v, u = np.nonzero(ring & (near == 0))
            yield from self._background((np.stack([u + left, v + top], axis=1) + 0.5) / [width, height])

    def _background(self, uv: Array) -> Iterator[tuple[str, Array, int]]:
        backdrop, table = self._scene.backdrop, self._rig.table
        x, y, _ = self._view.back_project(uv, 0.0).T
        on = (abs(x - table.centre[0]) <= table.half[0]) & (abs(y - table.centre[1]) <= table.half[1])
        if count := int(np.count_nonzero(on)):
            yield "the table", self._lit(np.outer(tones(backdrop.table), PAINTS[backdrop.colour])), count
        if count := int(np.count_nonzero(~on)):
            yield "wall and floor", self._lit([PAINTS[backdrop.wall], FLOOR_COLOUR]), count

    def _lit(self, albedo: Sequence[object] | Array) -> Array:
        colours = np.atleast_2d(np.asarray(albedo, dtype=np.float64))
        return shown(colours, UP[None], self._rig.lights, self._scene.light.intensity)


def _difference(colours: Array, areas: Array, shades: Array, least: float) -> float:
    """The difference from the nearest shade that colours on a share ``least`` of the area exceed."""
    apart = np.abs(colours[:, None] - shades).max(axis=2).min(axis=1)
    order = np.argsort(-apart)
    covered = np.cumsum(areas[order])
    return float(apart[order][np.searchsorted(covered, least * covered[-1])])


# Shares of what is seen of a target: less is never enough to find it (a sponge's edge is), the other always.
LEAST, MOST = 0.04, 0.5


def unseen(scene: Scene, catalogue: Catalogue, bounds: Visible, *, outlines: bool = False) -> str | None:
    """Why a person could not see a target of a scene that passes the other checks; None if they all are seen.

    ``outlines``: whether the policy gets outlines in flat colours instead of pictures.
    """
    scene = exposed(scene)
    picture = Picture(scene, catalogue)
    for index, placement in enumerate(scene.targets):
        model, seen = catalogue[placement.object], picture.hidden(index)
        if seen.inside < bounds.inside:
            least = f"at least {bounds.inside:.0%} is required"
            return f"{model.spoken}: only {seen.inside:.0%} of it is in the picture; {least}"
        if seen.unhidden < bounds.unhidden:
            most = f"at most {1 - bounds.unhidden:.0%} may be hidden"
            return f"{model.spoken}: {seen.by} hides {1 - seen.unhidden:.0%} of it; {most}"
        if seen.area < bounds.area:
            least = f"at least {bounds.area:.3%} is required"
            return f"{model.spoken}: it covers only {seen.area:.3%} of the picture; {least}"
        if outlines:
            apart, around, needed = _flat(scene, model), "the table", bounds.apart_in_outlines
        else:
            share = min(max(bounds.area / max(seen.area, bounds.area), LEAST), MOST)
            needed = max(bounds.apart, scene.noise.grain)
            apart, around = picture.apart(index, share)
        if apart < needed:
            difference = f"only {math.floor(apart)}/255 apart from {around}"
            light = f"under light × {scene.light.intensity:.3g}"
            return f"{model.spoken}: {difference} {light}; at least {needed:g}/255 is required"
    return None


def _flat(scene: Scene, model: ObjectModel) -> float:
    """The difference between an object's colour and the table's in outlines."""
    both = np.array([model.colour, PAINTS[scene.backdrop.colour]]) * scene.light.intensity
    thing, table = np.round(np.minimum(both, 1.0) * 255)
    return float(np.abs(thing - table).max())
