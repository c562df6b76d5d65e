"""A camera's view without a renderer: visible outlines of the objects, with their colours under the light.

Each convex part is projected by the scene's true camera and painted, farthest object first, into a label image 256
pixels wide.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import Outlines, Silhouette
from vlafuzz.worlds.manipulation.arms import hand_boxes
from vlafuzz.worlds.manipulation.camera import CameraPose, area_alone, blank, paint
from vlafuzz.worlds.manipulation.looks import COLOUR
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.state import State

Array = NDArray[np.float64]
HAND = 255  # label; objects are counted from 1, 0 is the background


def outlines(
    models: Sequence[ObjectModel], state: State, view: CameraPose, light: float, table: Sequence[float] = COLOUR
) -> Outlines:
    """Outlines of objects and hand in a view; colours, and the ``table``'s, are times ``light``, up to 1."""
    depth = [float((position - view.position) @ view.axes[0]) for position in state.positions]
    bodies = [
        [part @ turn.T + place for part in model.parts]
        for model, turn, place in zip(models, state.rotations, state.positions, strict=True)
    ]
    areas = [area_alone(body, view) for body in bodies]
    seen = blank(view)
    for index in sorted(range(len(models)), key=lambda i: -depth[i]):
        paint(seen, bodies[index], view, index + 1)
    paint(seen, hand_boxes(state.tcp, state.tcp_rotation, state.opening), view, HAND)
    things = []
    for label, (model, area) in enumerate(zip(models, areas, strict=True), 1):
        v, u = np.nonzero(seen == label)
        if len(u):
            pixels = np.stack([(u + 0.5) / seen.shape[1], (v + 0.5) / seen.shape[0]], axis=1)
            colour = np.minimum(model.colour * light, 1.0)
            things.append(Silhouette(pixels, colour, min(len(pixels) / area, 1.0)))
    # From left to right: the scene's order would reveal which object is the target
    things.sort(key=lambda thing: float(thing.pixels[:, 0].mean()))
    hand, distance = view.project(state.tcp[None])
    visible = bool(distance[0] > 0 and np.all((hand[0] >= 0) & (hand[0] <= 1)))
    return Outlines(tuple(things), hand[0] if visible else None, np.minimum(np.array(table) * light, 1.0))
