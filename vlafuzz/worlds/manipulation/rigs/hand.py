"""The hand that outlines show: boxes around palm and fingers, in the frame of the tool centre point."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# z points down, metres.
_PALM = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.10, 0.10) for z in (-0.13, -0.045)])
_FINGERS = [
    np.array([[x, s * y, z] for x in (-0.01, 0.01) for y in (0.0, 0.022) for z in (-0.05, 0.008)])
    for s in (1, -1)
]


def hand_boxes(tcp: Array, rotation: Array, opening: float) -> list[Array]:
    """``(8, 3)`` corners of each box in the world, metres. ``opening``: gap between the fingers."""
    half = opening / 2
    fingers = [box + np.array([0.0, np.sign(box[:, 1].sum()) * half, 0.0]) for box in _FINGERS]
    return [box @ rotation.T + tcp for box in (_PALM, *fingers)]
