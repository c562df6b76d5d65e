"""Who touches whom, read from PhysX."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sapien import physx

from vlafuzz.tasks.state import HAND

Labels = Mapping[object, int | str]
TOUCH_IMPULSE = 1e-6  # newton seconds; points within the contact offset but apart have none
Impulses = list[list[float]]  # of each point, three numbers; so few of them are faster without NumPy


def object_contacts(
    system: physx.PhysxCpuSystem, labels: Labels
) -> Iterator[tuple[int, int | str, object, Impulses]]:
    """What the first target touches, and what objects the hand touches, in the last physics step.

    Nobody asks what else touches what, and to read it takes time.

    Args:
        labels: body → index of an object, or the name of something else.

    Yields:
        object index, what it touches, that one's body, and the impulses between the two in newton seconds.
        Two objects come in both orders.
    """
    for contact in system.get_contacts():
        first, second = contact.bodies
        one, two = labels[first], labels[second]
        if not (one == 0 or two == 0 or one == HAND or two == HAND):
            continue
        impulses = [point.impulse.tolist() for point in contact.points]
        if all(max(map(abs, impulse)) < TOUCH_IMPULSE for impulse in impulses):
            continue
        if isinstance(one, int):
            yield one, two, second, impulses
        if isinstance(two, int):
            yield two, one, first, impulses
