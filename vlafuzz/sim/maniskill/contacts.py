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
) -> Iterator[tuple[int, int | str, physx.PhysxContact]]:
    """Every touch of an object in the last physics step.

    Args:
        labels: body → index of an object, or the name of something else.

    Yields:
        object index, what it touches, and the contact. Two objects come in both orders.
    """
    for contact in system.get_contacts():
        one, two = (labels[body] for body in contact.bodies)
        if not (isinstance(one, int) or isinstance(two, int)) or not _presses(contact):
            continue
        if isinstance(one, int):
            yield one, two, contact
        if isinstance(two, int):
            yield two, one, contact


def impulse(contact: physx.PhysxContact) -> Array:
    """``(3,)`` between the two bodies, newton seconds."""
    return np.sum([point.impulse for point in contact.points], axis=0, dtype=np.float64)


def _presses(contact: physx.PhysxContact) -> bool:
    # plain floats: this runs a dozen times a control step, and NumPy takes several times as long for three numbers
    return any(max(map(abs, point.impulse.tolist())) >= TOUCH_IMPULSE for point in contact.points)
