"""Pictures of an initial state for a person: as a policy's camera sees it, before and after it settles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vlafuzz.files import writing
from vlafuzz.sim.libero.env import HZ, LiberoEnv


def write_before_and_after(env: LiberoEnv, number: int, seconds: float, place: Path) -> None:
    """Write a PNG of both cameras (columns) at the start and after ``seconds`` of a still robot (rows).

    Raises:
        UsageError: the file cannot be written.
    """
    from PIL import Image

    env.reset(number)
    rows = [np.hstack(list(env.observe().pictures.values()))]
    env.settle(round(seconds * HZ))
    rows.append(np.hstack(list(env.observe().pictures.values())))
    with writing(place):
        Image.fromarray(np.vstack(rows)).save(place)
