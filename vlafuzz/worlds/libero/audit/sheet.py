"""Pictures of an initial state for a person: as a policy's cameras see it, while it settles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vlafuzz.common.files import writing
from vlafuzz.worlds.libero.env import HZ, LiberoEnv
from vlafuzz.worlds.libero.suites import SETTLING


def write_sheet(env: LiberoEnv, number: int, seconds: float, place: Path) -> None:
    """Write a PNG: both cameras (columns) at the start, after the settling steps, after ``seconds`` (rows).

    Raises:
        UsageError: the file cannot be written.
    """
    from PIL import Image

    env.reset(number)
    rows = []
    for steps in (0, SETTLING, round(seconds * HZ) - SETTLING):
        env.settle(steps)
        rows.append(np.hstack(list(env.observe().pictures.values())))
    with writing(place):
        Image.fromarray(np.vstack(rows)).save(place)
