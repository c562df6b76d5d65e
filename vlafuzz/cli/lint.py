"""``vlafuzz lint``."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress

from vlafuzz.cli.output import print_json, print_rows, progress
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.scene import Scene, read_scenes
from vlafuzz.space.catalogue import load_operators
from vlafuzz.validity import CHECKS, check_static

BROKEN = "broken"  # a line that is no scene


@dataclass(frozen=True)
class Problem:
    """What is wrong in a line; ``check`` is the one that it fails, or ``broken``."""

    line: int
    check: str
    reason: str


@dataclass(frozen=True)
class Verdicts:
    """What came of a file."""

    path: Path
    scenes: int
    problems: tuple[Problem, ...]

    def row(self) -> dict[str, Any]:
        """Counts: scenes, valid ones, and those that fail each check."""
        failed = Counter(problem.check for problem in self.problems)
        valid = self.scenes - sum(failed[check] for check in CHECKS)
        counts = {check: failed[check] for check in (*CHECKS, BROKEN)}
        return {"file": str(self.path), "scenes": self.scenes, "valid": valid} | counts


def command(
    files: Annotated[list[Path], typer.Argument(help="JSON-lines files of scenes.")],
    static: Annotated[
        bool, typer.Option("--static", help="Only what needs no simulator: semantics and geometry.")
    ] = False,
    min_distance: Annotated[
        float | None,
        typer.Option(help="Metres to keep between the centres of any two objects.", show_default="0.15"),
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is wrong in each line.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, each rejection with its line.")] = False,
) -> None:
    """Say whether the scenes of a file are fair.

    Checks: semantic, geometry, settling (a second of physics), not already solved. The exit code is 1 when a
    scene fails one of them or a line is broken.
    """
    if min_distance is not None and not min_distance >= 0:
        raise UsageError(f"--min-distance: expected metres, got {min_distance}")
    keep = load_operators().min_distance if min_distance is None else min_distance
    catalogue = load_catalogue()
    with progress() as bar:
        judged = [_judge(path, catalogue, keep, bar, dynamic=not static) for path in files]
    _print(judged, json=json, verbose=verbose)
    if any(each.problems for each in judged):
        raise typer.Exit(1)


def _judge(path: Path, catalogue: Catalogue, keep: float, bar: Progress, *, dynamic: bool) -> Verdicts:
    lines = list(read_scenes(path))
    problems: list[Problem] = []
    fair: list[tuple[int, Scene]] = []
    for number, scene in bar.track(lines, description=path.name):
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
        elif rejection := check_static(scene, catalogue, keep):
            problems.append(Problem(number, rejection.check, rejection.reason))
        else:
            fair.append((number, scene))
    if dynamic:
        problems += _judge_dynamically(fair, catalogue, bar)
    broken = sum(problem.check == BROKEN for problem in problems)
    return Verdicts(path, len(lines) - broken, tuple(sorted(problems, key=lambda problem: problem.line)))


def _judge_dynamically(fair: list[tuple[int, Scene]], catalogue: Catalogue, bar: Progress) -> list[Problem]:
    from vlafuzz.sim.maniskill.evaluator import check_dynamic_of

    problems = []
    for number, scene in bar.track(fair, description="settling"):
        if rejection := check_dynamic_of(scene, catalogue):
            problems.append(Problem(number, rejection.check, rejection.reason))
    return problems


def _print(judged: list[Verdicts], *, json: bool, verbose: bool) -> None:
    rows = [each.row() for each in judged]
    if json:
        rejections = [[asdict(problem) for problem in each.problems] for each in judged]
        print_json([row | {"rejections": each} for row, each in zip(rows, rejections, strict=True)])
        return
    if verbose:
        for each in judged:
            for problem in each.problems:
                typer.echo(f"{each.path}:{problem.line}: {problem.check}: {problem.reason}")
    print_rows(rows, title="scenes")
