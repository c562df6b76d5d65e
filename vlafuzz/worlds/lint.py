"""Verdicts on the scenes of a file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from vlafuzz.common.watch import Watch
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model import Rejection
from vlafuzz.model.outcome import FAIRNESS
from vlafuzz.model.scene_lines import is_document, read_scenes
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import Judge

BROKEN = "broken"  # a line that is no scene
MEANS = {"valid": "fair", **FAIRNESS, BROKEN: "lines that hold no scene"}  # what is counted


@dataclass(frozen=True)
class FileVerdicts:
    """The verdicts on the scenes of a file: how many, by what ``MEANS`` explains, and the problems by their lines."""

    path: Path
    counts: Mapping[str, int]
    problems: Mapping[int, Rejection]


def lint(path: Path, packs: Sequence[Any], watch: Watch, *, settle: bool) -> FileVerdicts:
    """Check all scenes of a file, with ``settle`` also simulated; a SceneError if there are none in it."""
    if is_document(path):
        hint = f"`vlafuzz export {path} --out F.jsonl` reads files of VLATest"
        raise SceneError(f"{path}: not JSON lines", hint)
    lines, problems = list(read_scenes(path)), dict[int, Rejection]()
    if not lines:
        raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")

    @cache
    def judge_of(task: str) -> Judge:
        try:
            return world_of(task).judge(packs, settle=settle)
        except UsageError as error:  # no such world, or one that cannot tell
            rejection = Rejection("semantic", f"{task}: {error.message}")
            return lambda _: rejection

    for done, (number, scene) in enumerate(lines):
        watch.progress(path.name, done, len(lines))
        if isinstance(scene, SceneError):
            problems[number] = Rejection(BROKEN, scene.message.removeprefix(f"{path}:{number}: "))
        elif rejection := judge_of(scene.task)(scene):
            problems[number] = rejection
    failed = Counter(problem.check for problem in problems.values())
    counts = {"scenes": len(lines) - failed[BROKEN], "valid": len(lines) - len(problems)}
    return FileVerdicts(path, counts | {check: failed[check] for check in (*FAIRNESS, BROKEN)}, problems)
