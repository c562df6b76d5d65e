"""Lint: which scenes of a file are fair."""

from collections import Counter
from pathlib import Path

from vlafuzz.common.watch import Watch
from vlafuzz.errors import SceneError
from vlafuzz.worlds.capabilities import FileVerdicts, Frame, Problem
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.tabletop.fairness.checks import CHECKS, check_static
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.vlatest import read_scene_file

BROKEN = "broken"  # a line that is no scene
MEANS = {
    "left out": "not read: an object has no counterpart here",
    "valid": "fair",
    "semantic": "with an unknown object, rest pose or task",
    "geometry": "with objects off the table, in each other, or too close",
    "unseen": "with a target that cannot be seen in the first picture",
    "settling": "in which something falls, rolls or shifts in the first second",
    "solved": "that are solved before the robot moves",
    BROKEN: "lines that hold no scene",
}


class TableLinter:
    """A ``Linter`` of scenes with the objects of a catalogue."""

    means = MEANS

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue, self._usual = catalogue, load_operators()

    @property
    def visibility(self) -> str:
        return str(self._usual.visible)

    def lint(self, path: Path, frame: Frame, min_distance: float | None, watch: Watch, *, settle: bool) -> FileVerdicts:
        source, problems = read_scene_file(path, self._catalogue, frame), list[Problem]()
        if not (source.lines or source.left_out):
            raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")
        apart = self._usual.min_distance if min_distance is None else min_distance
        for done, (number, scene) in enumerate(source.lines):
            watch.progress(path.name, done, len(source.lines))
            if isinstance(scene, SceneError):
                problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
                continue
            rejection = check_static(scene, self._catalogue, apart, self._usual.visible)
            if settle and rejection is None:
                from vlafuzz.worlds.tabletop.sim.settle import settled

                rejection = settled(scene, self._catalogue)
            if rejection:
                problems.append(Problem(number, rejection.check, rejection.reason))
        failed = Counter(problem.check for problem in problems)
        scenes = len(source.lines) - failed[BROKEN]
        counts = {
            "scenes": scenes,
            "left out": source.left_out,
            "valid": scenes - sum(failed[check] for check in CHECKS),
        }
        return FileVerdicts(path, counts | {check: failed[check] for check in (*CHECKS, BROKEN)}, problems)
