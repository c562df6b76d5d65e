"""Contacts read from PhysX: which bodies touch each other, and which object the fingers hold."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TypeAlias

from sapien import physx

from vlafuzz.tasks.base import HAND

Labels = Mapping[object, int | str]
Link: TypeAlias = physx.PhysxArticulationLinkComponent
Impulses = list[list[float]]  # three numbers per contact point; lists are faster than arrays at this size
Pressed = dict[Link, dict[int, Impulses]]  # by finger and object
TOUCH_IMPULSE = 1e-6  # newton seconds; smaller for bodies that are within the contact offset but apart
GRASP_FORCE = 0.5  # newtons per finger, as in ManiSkill's is_grasping
GRASP_COSINE = math.cos(math.radians(85.0))


def object_contacts(
    system: physx.PhysxCpuSystem, labels: Labels
) -> Iterator[tuple[int, int | str, object, Impulses]]:
    """Contacts of the first target, and of the hand with objects, in the last physics step.

    All other contacts are skipped: nobody needs them, and reading them takes time.

    Args:
        labels: from body to the index of an object, or the name of something else.

    Yields:
        Object index, label and body of what it touches, and the impulses between the two in newton seconds.
        A contact between two objects is reported in both orders.
    """
    for contact in system.get_contacts():
        first, second = contact.bodies
        label, other = labels[first], labels[second]
        if not (label == 0 or other == 0 or label == HAND or other == HAND):
            continue
        impulses = [point.impulse.tolist() for point in contact.points]
        if all(max(map(abs, impulse)) < TOUCH_IMPULSE for impulse in impulses):
            continue
        if isinstance(label, int):
            yield label, other, second, impulses
        if isinstance(other, int):
            yield other, label, first, impulses


def held_object(pressed: Pressed, hz: int) -> int | None:
    """The object that all fingers press on, given the impulses of a physics step of 1 / ``hz`` seconds."""
    for index in sorted(set.intersection(*map(set, pressed.values()))):
        if all(_presses(finger, objects[index], hz) for finger, objects in pressed.items()):
            return index
    return None


def _presses(finger: Link, impulses: Impulses, hz: int) -> bool:
    push = [sum(axis) for axis in zip(*impulses, strict=True)]
    size = math.hypot(*push)
    closing = finger.entity_pose.to_transformation_matrix()[:3, 1].tolist()
    along = sum(a * b for a, b in zip(closing, push, strict=True))
    return size * hz >= GRASP_FORCE and abs(along) >= GRASP_COSINE * size
