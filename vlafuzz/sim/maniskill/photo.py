"""A photo behind robot and objects, as VLATest's environments have it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

from vlafuzz import assets
from vlafuzz.rigs.rig import Rig

Picture = NDArray[np.uint8]


def photo_of(rig: Rig, task: str) -> Picture | None:
    """What a rig has behind it in a task; None where that is rendered.

    Raises:
        PrerequisiteError: the photo is in no folder of the user's.
    """
    if task not in rig.photos:
        return None
    path: Path = assets.need(f"overlays/{rig.photos[task]}", f"robot {rig.robot}")
    return np.asarray(imageio.imread(path), dtype=np.uint8)[..., :3]


def before(photo: Picture, picture: Picture, who: NDArray[np.integer], kept: Sequence[int]) -> Picture:
    """A picture with the photo wherever something else is seen than what is ``kept``.

    Args:
        who: ``(height, width)`` what each pixel shows, by SAPIEN's number of it in the scene.
    """
    height, width = who.shape
    behind = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    return np.where(np.isin(who, kept)[..., None], picture, behind).astype(np.uint8)
