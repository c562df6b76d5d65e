"""Crowding: statistics on how close objects stand in the scenes of a file, fair or not."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Placement, Scene
from vlafuzz.validity.footprint import apart, footprint

MARKER = "dummy_"  # prefix of planes that mark a place in SIMPLER's tasks and occupy no space


@dataclass(frozen=True)
class Crowding:
    """The crowding of a scene with at least two objects.

    Attributes:
        nearest: distance between the closest two centres, metres.
        overlap: whether any two footprints overlap; None if an object is not in the catalogue.
    """

    nearest: float
    overlap: bool | None


def crowding(scene: Scene, catalogue: Catalogue) -> Crowding | None:
    """The crowding of a scene; None with fewer than two objects."""
    things = [thing for thing in scene.placements if not thing.object.rpartition(":")[2].startswith(MARKER)]
    pairs = list(combinations(things, 2))
    if not pairs:
        return None
    nearest = min(math.dist((a.x, a.y), (b.x, b.y)) for a, b in pairs)
    return Crowding(nearest, _overlap(things, catalogue))


def share_closer(scenes: Iterable[Crowding], metres: float) -> float | None:
    """Share of the scenes with centres closer than this; None without scenes."""
    return share([scene.nearest < metres for scene in scenes])


def share_overlapping(scenes: Iterable[Crowding]) -> float | None:
    """Share of the scenes with overlapping footprints; None if that is not known of all scenes."""
    overlaps = [scene.overlap for scene in scenes]
    return None if None in overlaps else share([bool(overlap) for overlap in overlaps])


def share(flags: list[bool]) -> float | None:
    """Share of true flags; None without flags."""
    return round(sum(flags) / len(flags), 4) if flags else None


def is_known(things: Iterable[Placement], catalogue: Catalogue) -> bool:
    """Whether the footprints of all things are known."""
    return all(
        thing.object in catalogue
        and thing.scale > 0
        and (thing.quaternion or thing.rest in [pose.name for pose in catalogue[thing.object].stable_poses])
        for thing in things
    )


def _overlap(things: list[Placement], catalogue: Catalogue) -> bool | None:
    if not is_known(things, catalogue):
        return None
    outlines = [footprint(thing, catalogue[thing.object]) for thing in things]
    return any(not apart(a, b) for a, b in combinations(outlines, 2))
