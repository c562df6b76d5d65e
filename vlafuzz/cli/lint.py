"""``vlafuzz lint``."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress

from vlafuzz.cli.import_ import Frame
from vlafuzz.cli.output import print_json, print_rows, progress
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.corpus.sources import Source, is_vlatest, read_source
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.scene import Scene
from vlafuzz.space.catalogue import load_operators
from vlafuzz.validity import CHECKS, check_static
from vlafuzz.validity.crowding import Crowding, crowding, share_closer, share_overlapping

BROKEN = "broken"  # a line that is no scene
CLOSER = (0.15, 0.05)  # metres between centres


@dataclass(frozen=True)
class Problem:
    """What is wrong in a line; ``check`` is the one that it fails, or ``broken``."""

    line: int
    check: str
    reason: str


@dataclass(frozen=True)
class Verdicts:
    """What came of a file; ``crowded`` has the scenes of two objects or more."""

    path: Path
    scenes: int
    left_out: int
    problems: tuple[Problem, ...]
    crowded: tuple[Crowding, ...]

    def row(self) -> dict[str, Any]:
        """Counts: scenes, valid ones, those that fail each check; shares of those where things are close."""
        failed = Counter(problem.check for problem in self.problems)
        valid = self.scenes - sum(failed[check] for check in CHECKS)
        counts = {check: failed[check] for check in (*CHECKS, BROKEN)}
        closer = {f"< {metres} m": share_closer(self.crowded, metres) for metres in CLOSER}
        figures = closer | {"overlap": share_overlapping(self.crowded)}
        row = {"file": str(self.path), "scenes": self.scenes, "left out": self.left_out, "valid": valid}
        return row | counts | figures


def command(
    files: Annotated[list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's.")],
    static: Annotated[
        bool | None,
        typer.Option(
            "--static/--settle",
            help="Only what needs no simulator, semantics and geometry; or all.",
            show_default="all, for VLATest's files --static",
        ),
    ] = None,
    frame: Annotated[
        Frame, typer.Option(help="How VLATest's files are read: see `vlafuzz import vlatest`.")
    ] = Frame.FIT,
    min_distance: Annotated[
        float | None,
        typer.Option(help="Metres to keep between the centres of any two objects.", show_default="0.15"),
    ] = None,
    pack: PackFlag = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is wrong in each line.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, each rejection with its line.")] = False,
) -> None:
    """Say whether the scenes of a file are fair.

    Checks: semantic, geometry, settling (a second of physics), not already solved. The exit code is 1 when a
    scene fails one of them or a line is broken.

    Of the scenes with two objects or more: the shares in which two centres are closer than 0.15 m and than
    0.05 m, and in which footprints overlap.
    """
    if min_distance is not None and not min_distance >= 0:
        raise UsageError(f"--min-distance: expected metres, got {min_distance}")
    keep = load_operators().min_distance if min_distance is None else min_distance
    catalogue = load_catalogue(packs=opened(pack))
    with progress() as bar:
        judged = []
        for path in files:
            quick = is_vlatest(path) if static is None else static
            source = read_source(path, catalogue, frame.value)
            judged.append(_judge(source, catalogue, keep, bar, dynamic=not quick))
    _print(judged, json=json, verbose=verbose)
    if any(each.problems for each in judged):
        raise typer.Exit(1)


def _judge(source: Source, catalogue: Catalogue, keep: float, bar: Progress, *, dynamic: bool) -> Verdicts:
    path, problems, crowded = source.path, list[Problem](), list[Crowding | None]()
    fair: list[tuple[int, Scene]] = []
    for number, scene in bar.track(source.lines, description=path.name):
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
            continue
        crowded.append(crowding(scene, catalogue))
        if rejection := check_static(scene, catalogue, keep):
            problems.append(Problem(number, rejection.check, rejection.reason))
        else:
            fair.append((number, scene))
    if dynamic:
        problems += _judge_dynamically(fair, catalogue, bar)
    broken = sum(problem.check == BROKEN for problem in problems)
    return Verdicts(
        path,
        len(source.lines) - broken,
        source.left_out,
        tuple(sorted(problems, key=lambda problem: problem.line)),
        tuple(filter(None, crowded)),
    )


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
