"""A camera's pose and exposure in a scene; label images: convex bodies, painted without a renderer."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache
from itertools import accumulate

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.model import Camera, Light, Scene
from vlafuzz.model.scene import Exposure
from vlafuzz.worlds.manipulation.rigs import View
from vlafuzz.worlds.sight import CameraPose

Labels = Picture
Polygon = NDArray[np.int32]  # in OpenCV's fixed-point coordinates
WIDTH = 256  # pixels
SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates
NEAREST = 0.01  # metres; a body that reaches nearer to the camera's plane cannot be painted
MOST_GAIN = 8.0  # three stops: from 1/240 s, a usual exposure indoors, to 1/30 s, the longest at 30 pictures a second
OWN_GRAIN = 1.0  # grey levels: a step of eight bits, which a gain enlarges
_NOTHING: Polygon = np.zeros((0, 1, 2), dtype=np.int32)
_NOMINAL = Camera()


@lru_cache(maxsize=256)
def camera_pose(view: View, camera: Camera = _NOMINAL) -> CameraPose:
    """The pose of the nominal view displaced by a scene's camera offset and rotation.

    Roll, pitch and yaw rotate it about its own forward, left and up axes, in the order yaw, pitch, roll.
    """
    turn = Rotation.from_euler("ZYX", [camera.yaw, camera.pitch, camera.roll], degrees=True).as_matrix()
    return CameraPose(np.array(view.eye) + np.array(camera.offset), turn.T @ _axes(view), view.fov, view.aspect)


def exposed(scene: Scene) -> Scene:
    """The scene with a fixed exposure that gives the same pictures, in light that is not clipped yet.

    All lights have one factor, so the mean luminance of a picture is that of the nominal light times the factor. The
    exposure makes up for it, as far as it follows and by at most ``MOST_GAIN``; what is brightened has more noise.
    """
    if scene.exposure == Exposure():
        return scene
    gain = min(max(1 / max(scene.light.intensity, 1e-9), 1 / MOST_GAIN), MOST_GAIN) ** scene.exposure.auto
    grain = math.hypot(scene.noise.grain * max(gain, 1.0), OWN_GRAIN * max(gain - 1.0, 0.0))
    light, noise = Light(scene.light.intensity * gain), replace(scene.noise, grain=grain)
    return replace(scene, light=light, noise=noise, exposure=Exposure())


@cache
def _axes(view: View) -> Array:
    """``(3, 3)`` rows: the axes of the nominal view, forward, left and up."""
    forward = np.array(view.target) - np.array(view.eye)
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    return np.stack([forward, left, np.cross(forward, left)])


def blank(view: CameraPose) -> Labels:
    """An empty label image ``(height, WIDTH)`` of a view."""
    return np.zeros((round(WIDTH / view.aspect), WIDTH), dtype=np.uint8)


def paint(picture: Labels, parts: Sequence[Array], view: CameraPose, label: int) -> None:
    """Paint convex parts, ``(k, 3)`` corners each, over what is there."""
    fill(picture, polygons(parts, view), label)


def polygons(parts: Sequence[Array], view: CameraPose) -> list[Polygon]:
    """The outline of each convex part in a label image; an empty one for a part that cannot be painted."""
    uv, depth = view.project(np.concatenate(parts))
    size = [WIDTH, round(WIDTH / view.aspect)]
    points = np.round((uv * size - 0.5) * 2**SUBPIXEL).astype(np.int32)
    ends = list(accumulate(map(len, parts)))
    spans = [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]
    near = np.minimum.reduceat(depth, [0, *ends[:-1]]) <= NEAREST
    drawn = zip(spans, near, strict=True)
    return [_NOTHING if too_near else cv2.convexHull(points[span]) for span, too_near in drawn]


def fill(picture: Labels, outlines: Sequence[Polygon], label: int) -> None:
    """Paint ``polygons`` over what is there."""
    for outline in outlines:
        if len(outline):
            cv2.fillConvexPoly(picture, outline, label, lineType=cv2.LINE_8, shift=SUBPIXEL)


def area_alone(parts: Sequence[Array], view: CameraPose) -> int:
    """Pixels of a whole outline with nothing before it, those beyond the image included."""
    alone = blank(view)
    paint(alone, parts, view, 1)
    return max(area_beyond(parts, view), int(np.count_nonzero(alone)))


def area_beyond(parts: Sequence[Array], view: CameraPose) -> int:
    """Area of the whole outline in pixels if it extends beyond the image; else 0."""
    uv, _ = view.project(np.concatenate(parts))
    if np.all((uv >= 0) & (uv <= 1)):
        return 0
    hull = cv2.convexHull((uv * [WIDTH, round(WIDTH / view.aspect)]).astype(np.float32))
    return round(float(cv2.contourArea(hull)))
