"""States of the tabletop, made by hand."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.tasks import HAND, TABLE, State, StateMonitor

CATALOGUE = load_catalogue()
CAN, CUBE, PLATE, BASKET, SPONGE = (CATALOGUE[n] for n in ("coke_can", "green_cube", "plate", "basket", "sponge"))
REST = {model.name: model.stable_poses[0].height for model in (CAN, CUBE, PLATE, BASKET, SPONGE)}
HELD = {(0, HAND)}

STEP = 0.2  # seconds


def state(
    *positions: Sequence[float],
    held: int | None = None,
    touching: set[tuple[int, int | str]] | None = None,
    speed: float = 0.0,
    spin: float = 0.0,
    turned: dict[int, Rotation] | None = None,
    tcp: Sequence[float] | None = None,
) -> State:
    """Objects upright at some positions; everything on the table and at rest unless said otherwise."""
    rotations = np.stack([np.eye(3)] * len(positions))
    for index, rotation in (turned or {}).items():
        rotations[index] = rotation.as_matrix()
    now = np.array(positions, dtype=np.float64)
    turn = Rotation.from_euler("y", spin * STEP).as_matrix()
    return State(
        positions=now,
        rotations=rotations,
        earlier=(now - [speed * STEP, 0, 0], rotations @ turn),
        seconds=STEP,
        tcp=np.array(tcp if tcp is not None else [0.0, 0.0, 0.17]),
        tcp_rotation=np.eye(3),
        opening=0.04,
        held=held,
        contacts=frozenset({(i, TABLE) for i in range(len(positions))} if touching is None else touching),
    )


def watch(monitor: StateMonitor, *states: State) -> StateMonitor:
    for state in states:
        monitor.observe(state)
    return monitor
