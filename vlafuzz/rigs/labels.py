"""Label images: convex bodies, painted through a camera without a renderer."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vlafuzz.rigs.camera import CameraPose

Array = NDArray[np.float64]
Labels = NDArray[np.uint8]
WIDTH = 256  # pixels
SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates
NEAREST = 0.01  # metres; a body that reaches nearer to the camera's plane cannot be painted


def blank(view: CameraPose) -> Labels:
    """An empty label image ``(height, WIDTH)`` of a view."""
    return np.zeros((round(WIDTH / view.aspect), WIDTH), dtype=np.uint8)


def paint(picture: Labels, parts: Sequence[Array], view: CameraPose, label: int) -> None:
    """Paint convex parts, ``(k, 3)`` corners each, over what is there."""
    height, width = picture.shape
    for part in parts:
        uv, depth = view.project(part)
        if depth.min() <= NEAREST:
            continue
        points = np.round((uv * [width, height] - 0.5) * 2**SUBPIXEL).astype(np.int32)
        cv2.fillConvexPoly(picture, cv2.convexHull(points), label, lineType=cv2.LINE_8, shift=SUBPIXEL)


def area_alone(parts: Sequence[Array], view: CameraPose) -> int:
    """Pixels of a whole outline with nothing before it, those beyond the image included."""
    alone = blank(view)
    paint(alone, parts, view, 1)
    return max(_area_beyond(parts, view, len(alone)), int(np.count_nonzero(alone)))


def _area_beyond(parts: Sequence[Array], view: CameraPose, height: int) -> int:
    """Area of the whole outline if it extends beyond the image; else 0."""
    uv, _ = view.project(np.concatenate(parts))
    if np.all((uv >= 0) & (uv <= 1)):
        return 0
    hull = cv2.convexHull((uv * [WIDTH, height]).astype(np.float32))
    return round(float(cv2.contourArea(hull)))
