"""Lint: whether the scenes of a file are fair, and how crowded they are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import SceneFile
from vlafuzz.worlds.capabilities import Frame, Problem
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.rigs.robots import RIGS
from vlafuzz.worlds.tabletop.fairness import CHECKS, check_static
from vlafuzz.worlds.tabletop.fairness.footprint import (
    Crowding,
    crowding,
    is_known,
    share,
    share_closer,
    share_overlapping,
)
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.vlatest.read import read_scene_file

if TYPE_CHECKING:
    from vlafuzz.worlds.tabletop.sim.settle import Settled

BROKEN = "broken"  # a line that is no scene
CLOSER = (0.15, 0.05)  # metres between centres
SHIFTED = 0.05  # metres, seen from above
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
        (f"< {metres} m" for metres in CLOSER),
        "with two centres closer than that, of those with several objects",
    ),
}


@dataclass(frozen=True, kw_only=True)
class Verdicts:
    """The verdicts on a file; ``crowded`` has scenes of two or more objects, ``settled`` settled scenes."""

    path: Path
    scenes: int
    left_out: int
    problems: tuple[Problem, ...]
    crowded: tuple[Crowding, ...]
    settled: tuple[Settled, ...]

    def row(self) -> dict[str, Any]:
        """Counts of scenes, valid and failing each check; shares of scenes in which objects are close."""
        failed = Counter(problem.check for problem in self.problems)
        valid = self.scenes - sum(failed[check] for check in CHECKS)
        counts = {check: failed[check] for check in (*CHECKS, BROKEN)}
        closer = {f"< {metres} m": share_closer(self.crowded, metres) for metres in CLOSER}
        figures = closer | {"overlap": share_overlapping(self.crowded)}
        if self.settled:
            figures |= {
                f"moved > {SHIFTED} m": share([scene.shift > SHIFTED for scene in self.settled]),
                "solved already": share([scene.solved for scene in self.settled]),
                "as published": share([scene.published for scene in self.settled]),
            }
        row = {"file": str(self.path), "scenes": self.scenes, "left out": self.left_out, "valid": valid}
        return row | counts | figures


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
        visible: bounds within which the targets count as visible; None to skip that check.
        placement: how objects are placed before they settle; None to skip settling.
    """
    path, problems, crowded = source.path, list[Problem](), list[Crowding | None]()
    known: list[tuple[int, Scene]] = []
    for done, (number, scene) in enumerate(source.lines):
        watch.progress(path.name, done, len(source.lines))
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
            continue
        if rejection := check_static(scene, catalogue, min_distance, visible):
            problems.append(Problem(number, rejection.check, rejection.reason))
        crowded.append(crowding(scene, catalogue))
        if _can_settle(scene, catalogue):
            known.append((number, scene))
    settled = _settle(known, catalogue, placement, watch) if placement else {}
    invalid = {problem.line for problem in problems}
    problems += [
        Problem(number, scene.rejection.check, scene.rejection.reason)
        for number, scene in settled.items()
        if scene.rejection and number not in invalid
    ]
    broken = sum(problem.check == BROKEN for problem in problems)
    return Verdicts(
        path=path,
        scenes=len(source.lines) - broken,
        left_out=source.left_out,
        problems=tuple(sorted(problems, key=lambda problem: problem.line)),
        crowded=tuple(filter(None, crowded)),
        settled=tuple(settled.values()),
    )


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


def _can_settle(scene: Scene, catalogue: Catalogue) -> bool:
    ours = not scene.frame and scene.task in TASKS and scene.robot in RIGS
    return ours and is_known(scene.placements, catalogue)


def _settle(
    scenes: list[tuple[int, Scene]], catalogue: Catalogue, placement: str, watch: Watch
) -> dict[int, Settled]:
    from vlafuzz.worlds.tabletop.sim.evaluator import settled

    results = {}
    for done, (number, scene) in enumerate(scenes):
        watch.progress("settling", done, len(scenes))
        results[number] = settled(scene, catalogue, placement)
    return results
