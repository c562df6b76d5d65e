"""A camera's view without a renderer: visible outlines of the objects, with their colours under the light.

Each convex part is projected by the scene's true camera and painted, farthest object first, into a label
image 256 pixels wide.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.objects.model import ObjectModel
from vlafuzz.policies.base import Outlines, Silhouette
from vlafuzz.rigs.camera import CameraPose
from vlafuzz.sim.maniskill.table import COLOUR
from vlafuzz.tasks.base import State

Array = NDArray[np.float64]
WIDTH = 256
SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates
HAND = 255  # label; objects are counted from 1, 0 is the background
# The hand as boxes around palm and fingers, in the TCP's frame (z points down), metres.
_HAND_BOX = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.10, 0.10) for z in (-0.13, -0.045)])
_FINGER_BOXES = [
    np.array([[x, s * y, z] for x in (-0.01, 0.01) for y in (0.0, 0.022) for z in (-0.05, 0.008)])
    for s in (1, -1)
]


def outlines(
    models: Sequence[ObjectModel],
    state: State,
    view: CameraPose,
    light: float,
    table: Sequence[float] = COLOUR,
) -> Outlines:
    """Outlines of objects and hand, and the mean colour of the ``table`` top, in a view.

    ``light``: factor on all lights; an apparent colour saturates at 1.
    """
    height = round(WIDTH / view.aspect)
    depth = [float((position - view.position) @ view.axes[0]) for position in state.positions]
    bodies = [_corners(model, state, index) for index, model in enumerate(models)]
    seen = np.zeros((height, WIDTH), dtype=np.uint8)
    areas = []
    for body in bodies:
        alone = np.zeros_like(seen)
        _paint(alone, body, view, 1)
        areas.append(max(_size(body, view, height), int(alone.sum())))
    for index in sorted(range(len(models)), key=lambda i: -depth[i]):
        _paint(seen, bodies[index], view, index + 1)
    _paint(seen, _hand(state), view, HAND)
    things = [
        Silhouette(pixels, np.minimum(model.colour * light, 1.0), min(len(pixels) / area, 1.0))
        for label, (model, area) in enumerate(zip(models, areas, strict=True), 1)
        if len(pixels := _pixels(seen, label))
    ]
    # From left to right: the scene's order would reveal which object is the target
    things.sort(key=lambda thing: float(thing.pixels[:, 0].mean()))
    hand, distance = view.project(state.tcp[None])
    visible = bool(distance[0] > 0 and np.all((hand[0] >= 0) & (hand[0] <= 1)))
    return Outlines(tuple(things), hand[0] if visible else None, np.minimum(np.array(table) * light, 1.0))


def _corners(model: ObjectModel, state: State, index: int) -> list[Array]:
    return [part @ state.rotations[index].T + state.positions[index] for part in model.parts]


def _hand(state: State) -> list[Array]:
    half = state.opening / 2
    fingers = [box + np.array([0.0, np.sign(box[:, 1].sum()) * half, 0.0]) for box in _FINGER_BOXES]
    return [box @ state.tcp_rotation.T + state.tcp for box in (_HAND_BOX, *fingers)]


def _paint(picture: NDArray[np.uint8], parts: list[Array], view: CameraPose, value: int) -> None:
    height, width = picture.shape
    for part in parts:
        uv, depth = view.project(part)
        if depth.min() <= 0.01:
            continue
        points = np.round((uv * [width, height] - 0.5) * 2**SUBPIXEL).astype(np.int32)
        cv2.fillConvexPoly(picture, cv2.convexHull(points), value, lineType=cv2.LINE_8, shift=SUBPIXEL)


def _size(parts: list[Array], view: CameraPose, height: int) -> int:
    """Area in pixels of the whole outline if it extends beyond the image; else 0."""
    uv, _ = view.project(np.concatenate(parts))
    if np.all((uv >= 0) & (uv <= 1)):
        return 0
    hull = cv2.convexHull((uv * [WIDTH, height]).astype(np.float32))
    return round(float(cv2.contourArea(hull)))


def _pixels(seen: NDArray[np.uint8], value: int) -> Array:
    v, u = np.nonzero(seen == value)
    height, width = seen.shape
    return np.stack([(u + 0.5) / width, (v + 0.5) / height], axis=1)
