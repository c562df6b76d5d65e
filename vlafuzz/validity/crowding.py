"""How close the objects of a scene stand, fair or not: figures about files of scenes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Placement, Scene
from vlafuzz.validity.footprint import apart, footprint

MARKER = "dummy_"  # planes that mark a place in SIMPLER's tasks: they take no room


@dataclass(frozen=True)
class Crowding:
    """A scene of two objects or more.

    Attributes:
        nearest: between the centres of the two that are closest, metres.
        overlap: whether any two footprints overlap; None where an object is not in the catalogue.
    """

    nearest: float
    overlap: bool | None


def crowding(scene: Scene, catalogue: Catalogue) -> Crowding | None:
    """How close its objects stand; None where there are not two."""
    things = [each for each in scene.placements if not each.object.rpartition(":")[2].startswith(MARKER)]
    pairs = list(combinations(things, 2))
    if not pairs:
        return None
    nearest = min(math.dist((a.x, a.y), (b.x, b.y)) for a, b in pairs)
    return Crowding(nearest, _overlap(things, catalogue))


def share_closer(found: Iterable[Crowding], metres: float) -> float | None:
    """Share of the scenes that have a pair of centres closer than this; None of no scenes."""
    return share([each.nearest < metres for each in found])


def share_overlapping(found: Iterable[Crowding]) -> float | None:
    """Share of the scenes with overlapping footprints; None where an object is not known in one of them."""
    overlaps = [each.overlap for each in found]
    return None if None in overlaps else share([bool(each) for each in overlaps])


def share(found: list[bool]) -> float | None:
    """Of those that are true; None of none."""
    return round(sum(found) / len(found), 4) if found else None


def is_known(things: Iterable[Placement], catalogue: Catalogue) -> bool:
    """Whether it is known where each of some things is solid."""
    return all(
        thing.object in catalogue
        and thing.scale > 0
        and (thing.quaternion or thing.rest in [pose.name for pose in catalogue[thing.object].stable_poses])
        for thing in things
    )


def _overlap(things: list[Placement], catalogue: Catalogue) -> bool | None:
    if not is_known(things, catalogue):
        return None
    prints = [footprint(thing, catalogue[thing.object]) for thing in things]
    return any(not apart(a, b) for a, b in combinations(prints, 2))
