"""The picture of docs/libero-audit.md: each kind of defect in an initial state of LIBERO or LIBERO-PRO.

Needs scripts/setup-libero; takes a minute.

    python scripts/defect_pictures.py --out docs/pictures
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from operator_pictures import OUT, SIDE, Panel, strip

from vlafuzz.worlds.libero.env import HZ, LiberoEnv
from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.suites import find_task
from vlafuzz.worlds.opengl import Canvas


class Shot(NamedTuple):
    """A state and how it is looked at: what a free camera turns to, from which side (degrees) and distance (metres).

    ``moments``: seconds for which the robot keeps still before each picture. ``lift``: of what is looked at, metres.
    """

    kind: str
    task: str
    state: int
    thing: str
    azimuth: float
    elevation: float
    distance: float
    moments: tuple[float, ...] = (0.0, 2.0)
    lift: float = 0.0


SHOTS = (
    Shot("overlaps", "libero_object/0", 0, "milk_1", 180, -8, 0.45),
    Shot("moving", "libero_10/0", 0, "ketchup_1", 180, -12, 1.3, (0.0, 0.5), 0.2),
    Shot("slides", "libero_spatial/5", 0, "akita_black_bowl_1", 180, -20, 0.5),
    Shot("falls", "libero_10/3", 19, "wine_bottle_1", 150, -15, 1.0, (0.0, 0.6)),
    Shot("region", "libero_goal_swap/5", 0, "akita_black_bowl_1", 225, -30, 0.8),
    Shot("premise", "libero_spatial_swap/8", 0, "akita_black_bowl_1", 180, -35, 1.1, (0.0,)),
    Shot("solved", "libero_study_table/1", 0, "white_bowl_1", 180, -30, 1.1, (0.0,)),
)


def panels(shot: Shot) -> Iterator[Panel]:
    """The pictures of a shot with their captions."""
    env, mujoco = LiberoEnv(find_task(shot.task), size=64), load("mujoco")
    env.reset(shot.state)
    canvas = Canvas(env.model, SIDE, SIDE)
    canvas.options.geomgroup[0] = 0  # shapes that collide
    canvas.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    canvas.camera.lookat[:] = np.add(env.place(shot.thing), (0, 0, shot.lift))
    canvas.camera.azimuth, canvas.camera.elevation, canvas.camera.distance = shot[4:7]
    for seconds in shot.moments:
        env.settle(round(seconds * HZ) - env.steps)
        mujoco.mj_camlight(env.model, env.data)
        when = f"after {seconds:g} s" if seconds else "at the start"
        yield np.ascontiguousarray(canvas.draw(env.data, SIDE, SIDE)[::-1]), f"{shot.kind} ({shot.task}), {when}"
    canvas.close()
    env.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT, help="folder for the JPEG")
    sheet = strip([panel for shot in SHOTS for panel in panels(shot)], columns=4)
    sheet.save(parser.parse_args().out / "libero-defects.jpg", quality=75, optimize=True)


if __name__ == "__main__":
    main()
