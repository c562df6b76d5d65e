"""Verdicts on the scenes of a file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.common.watch import Watch
from vlafuzz.errors import SceneError
from vlafuzz.model.scene_lines import is_document, read_scenes
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.tabletop.fairness.checks import CHECKS, check_static
from vlafuzz.worlds.tabletop.objects import Pack, load_catalogue

BROKEN = "broken"  # a line that is no scene
# What is counted.
MEANS = {
    "valid": "fair",
    "semantic": "with an unknown object, rest pose or task",
    "geometry": "with objects off the table, in each other, or too close",
    "unseen": "with a target that cannot be seen in the first picture",
    "settling": "in which something falls, rolls or shifts in the first second",
    "solved": "that are solved before the robot moves",
    BROKEN: "lines that hold no scene",
}


@dataclass(frozen=True)
class Problem:
    """A problem in a line of a file of scenes; ``check`` is the check that the line fails, or ``broken``."""

    line: int
    check: str
    reason: str


@dataclass(frozen=True)
class FileVerdicts:
    """The verdicts on the scenes of a file; ``counts`` of scenes by what ``MEANS`` explains."""

    path: Path
    counts: Mapping[str, int]
    problems: Sequence[Problem]


def lint(path: Path, packs: Sequence[Pack], watch: Watch, *, settle: bool) -> FileVerdicts:
    """Check all scenes of a file, with ``settle`` also simulated; a SceneError if there are none in it."""
    catalogue, usual = load_catalogue(packs=packs), load_operators()
    if is_document(path):
        raise SceneError(
            f"{path}: not JSON lines", hint=f"`vlafuzz export {path} --out F.jsonl` reads files of VLATest"
        )
    lines, problems = list(read_scenes(path)), list[Problem]()
    if not lines:
        raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")
    for done, (number, scene) in enumerate(lines):
        watch.progress(path.name, done, len(lines))
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
            continue
        rejection = check_static(scene, catalogue, usual.min_distance, usual.visible)
        if settle and rejection is None:
            from vlafuzz.worlds.tabletop.sim.world import settled

            rejection = settled(scene, catalogue)
        if rejection:
            problems.append(Problem(number, rejection.check, rejection.reason))
    failed = Counter(problem.check for problem in problems)
    scenes = len(lines) - failed[BROKEN]
    counts = {"scenes": scenes, "valid": scenes - sum(failed[check] for check in CHECKS)}
    return FileVerdicts(path, counts | {check: failed[check] for check in (*CHECKS, BROKEN)}, problems)
