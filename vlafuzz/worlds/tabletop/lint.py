"""Lint: whether the scenes of a file are fair, and how crowded they are."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.model.scene_lines import SceneFile
from vlafuzz.worlds.capabilities import Frame, Problem
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.rigs import RIGS
from vlafuzz.worlds.tabletop.fairness import CHECKS, check_static
from vlafuzz.worlds.tabletop.fairness.footprint import apart, footprint
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.vlatest import read_scene_file

if TYPE_CHECKING:
    from vlafuzz.worlds.tabletop.sim.settle import Settled

BROKEN = "broken"  # a line that is no scene
CLOSER = (0.15, 0.05)  # metres between centres
SHIFTED = 0.05  # metres, seen from above
MARKER = "dummy_"  # prefix of planes that mark a place in SIMPLER's tasks and occupy no space
MEANS = {
    "left out": "not read: an object has no counterpart here",
    "valid": "fair",
    "semantic": "with an unknown object, rest pose or task",
    "geometry": "with objects off the table, in each other, or too close",
    "unseen": "with a target that cannot be seen in the first picture",
    "settling": "in which something falls, rolls or shifts in the first second",
    "solved": "that are solved before the robot moves",
    "broken": "lines that hold no scene",
    "overlap": "with footprints that overlap, of those with several objects",
    f"moved > {SHIFTED} m": "in which something moves farther while it settles",
    "solved already": "solved after settling, fair or not",
    "as published": "the same by the published criteria",
    **dict.fromkeys(
        (f"< {metres} m" for metres in CLOSER), "with two centres closer than that, of those with several objects"
    ),
}


@dataclass(frozen=True, kw_only=True)
class Verdicts:
    """The verdicts on a file.

    ``nearest``: the least distance of two centres in each scene with several objects, metres. ``overlaps``: whether
    footprints of it overlap; None if an object is not in the catalogue. ``settled``: settled scenes.
    """

    path: Path
    scenes: int
    left_out: int
    problems: tuple[Problem, ...]
    nearest: tuple[float, ...]
    overlaps: tuple[bool | None, ...]
    settled: tuple[Settled, ...]

    def row(self) -> dict[str, Any]:
        """Counts of scenes, valid and failing each check; shares of scenes in which objects are close."""
        failed = Counter(problem.check for problem in self.problems)
        valid = self.scenes - sum(failed[check] for check in CHECKS)
        row: dict[str, Any] = {"file": str(self.path), "scenes": self.scenes, "left out": self.left_out}
        row |= {"valid": valid, **{check: failed[check] for check in (*CHECKS, BROKEN)}}
        row |= {f"< {metres} m": _share([near < metres for near in self.nearest]) for metres in CLOSER}
        row["overlap"] = _share(self.overlaps)
        if self.settled:
            row |= {
                f"moved > {SHIFTED} m": _share([scene.shift > SHIFTED for scene in self.settled]),
                "solved already": _share([scene.solved for scene in self.settled]),
                "as published": _share([scene.published for scene in self.settled]),
            }
        return row


def _share(flags: Sequence[bool | None]) -> float | None:
    """Share of true flags; None without flags, or if one is not known."""
    return None if None in flags or not flags else round(sum(map(bool, flags)) / len(flags), 4)


def lint(
    source: SceneFile,
    catalogue: Catalogue,
    min_distance: float,
    visible: Visible | None = None,
    *,
    placement: str | None = None,
    watch: Watch = SILENT,
) -> Verdicts:
    """Check all scenes of a file.

    Args:
        min_distance: to keep between the centres of any two objects, metres.
        visible: bounds within which the targets count as visible; None to skip that check. placement: how objects are
        placed before they settle; None to skip settling.
    """
    path, problems = source.path, list[Problem]()
    nearest, overlaps = list[float](), list[bool | None]()
    known: dict[int, Scene] = {}
    for done, (number, scene) in enumerate(source.lines):
        watch.progress(path.name, done, len(source.lines))
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
            continue
        if rejection := check_static(scene, catalogue, min_distance, visible):
            problems.append(Problem(number, rejection.check, rejection.reason))
        things = [it for it in scene.placements if not it.object.rpartition(":")[2].startswith(MARKER)]
        if len(things) > 1:
            nearest.append(min(math.dist((a.x, a.y), (b.x, b.y)) for a, b in combinations(things, 2)))
            overlaps.append(_overlap(things, catalogue))
        ours = not scene.frame and scene.task in TASKS and scene.robot in RIGS
        if ours and all(_is_known(it, catalogue) for it in scene.placements):
            known[number] = scene
    settled = _settle(known, catalogue, placement, watch) if placement else {}
    invalid = {problem.line for problem in problems}
    problems += [
        Problem(number, scene.rejection.check, scene.rejection.reason)
        for number, scene in settled.items()
        if scene.rejection and number not in invalid
    ]
    return Verdicts(
        path=path,
        scenes=len(source.lines) - sum(problem.check == BROKEN for problem in problems),
        left_out=source.left_out,
        problems=tuple(sorted(problems, key=lambda problem: problem.line)),
        nearest=tuple(nearest),
        overlaps=tuple(overlaps),
        settled=tuple(settled.values()),
    )


def _is_known(thing: Placement, catalogue: Catalogue) -> bool:
    """Whether a thing's footprint is known."""
    if thing.object not in catalogue or not thing.scale > 0:
        return False
    if thing.quaternion is not None:
        return math.hypot(*thing.quaternion) > 1e-6
    return thing.rest in [pose.name for pose in catalogue[thing.object].stable_poses]


def _overlap(things: Sequence[Placement], catalogue: Catalogue) -> bool | None:
    if not all(_is_known(thing, catalogue) for thing in things):
        return None
    outlines = [footprint(thing, catalogue[thing.object]) for thing in things]
    return any(not apart(a, b) for a, b in combinations(outlines, 2))


def _settle(scenes: dict[int, Scene], catalogue: Catalogue, placement: str, watch: Watch) -> dict[int, Settled]:
    from vlafuzz.worlds.tabletop.sim.evaluator import settled

    results = {}
    for done, (number, scene) in enumerate(scenes.items()):
        watch.progress("settling", done, len(scenes))
        results[number] = settled(scene, catalogue, placement)
    return results


class TableLinter:
    """A ``Linter`` of scenes with the objects of a catalogue."""

    means = MEANS

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue, self._usual = catalogue, load_operators()

    @property
    def visibility(self) -> str:
        return str(self._usual.visible)

    def lint(
        self, path: Path, frame: Frame, min_distance: float | None, placement: str | None, watch: Watch
    ) -> Verdicts:
        source = read_scene_file(path, self._catalogue, frame)
        if not (source.lines or source.left_out):
            raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")
        apart = self._usual.min_distance if min_distance is None else min_distance
        return lint(source, self._catalogue, apart, self._usual.visible, placement=placement, watch=watch)
