"""Who touches whom, read from PhysX."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from sapien import physx

Array = NDArray[np.float64]
Labels = Mapping[object, int | str]
TOUCH_IMPULSE = 1e-6  # newton seconds; points within the contact offset but apart have none


def object_contacts(
    system: physx.PhysxCpuSystem, labels: Labels
) -> Iterator[tuple[int, int | str, tuple[object, ...], Array]]:
    """Every touch of an object in the last physics step.

    Args:
        labels: body → index of an object, or the name of something else.

    Yields:
        object index, what it touches, the two bodies, and the impulse between them, ``(3,)`` in newton seconds.
        Two objects come in both orders.
    """
    for contact in system.get_contacts():
        bodies = tuple(contact.bodies)
        one, two = (labels[body] for body in bodies)
        if not (isinstance(one, int) or isinstance(two, int)):
            continue
        # plain floats: for so few of them NumPy takes several times as long
        sums = [sum(axis) for axis in zip(*(point.impulse.tolist() for point in contact.points), strict=True)]
        if max(map(abs, sums), default=0.0) < TOUCH_IMPULSE:
            continue
        impulse = np.array(sums)
        if isinstance(one, int):
            yield one, two, bodies, impulse
        if isinstance(two, int):
            yield two, one, bodies, impulse
