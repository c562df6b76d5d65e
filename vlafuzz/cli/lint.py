"""``vlafuzz lint``."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import Progress

from vlafuzz.cli.flags import PlacementFlag
from vlafuzz.cli.import_ import Frame
from vlafuzz.cli.output import print_json, print_rows, progress, stderr
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.conditions.conditions import PLACEMENTS, check_choice
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.formats.scene_lines import SceneFile
from vlafuzz.formats.sources import is_vlatest, read_scene_file
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.rigs.robots import RIGS
from vlafuzz.scene import Scene
from vlafuzz.space.operator_set import load_operators
from vlafuzz.tasks.tabletop import TASKS
from vlafuzz.validity import CHECKS, check_static
from vlafuzz.validity.crowding import Crowding, crowding, is_known, share, share_closer, share_overlapping

if TYPE_CHECKING:
    from vlafuzz.sim.maniskill.settle import Settled

BROKEN = "broken"  # a line that is no scene
CLOSER = (0.15, 0.05)  # metres between centres
SHIFTED = 0.05  # metres, seen from above
PACKED = re.compile("unknown object '[^']+:")  # a reason


@dataclass(frozen=True)
class Problem:
    """A problem in a line; ``check`` is the check that the line fails, or ``broken``."""

    line: int
    check: str
    reason: str


@dataclass(frozen=True)
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


def command(
    files: Annotated[list[Path], typer.Argument(help="Files of scenes: JSON lines, or VLATest's.")],
    static: Annotated[
        bool | None,
        typer.Option(
            "--static/--settle",
            help="Only what needs no simulator, semantics and geometry; or all.",
            show_default="all; for VLATest's files --static, unless --placement is given",
        ),
    ] = None,
    frame: Annotated[
        Frame, typer.Option(help="How VLATest's files are read: see `vlafuzz import vlatest`.")
    ] = Frame.FIT,
    min_distance: Annotated[
        float | None,
        typer.Option(help="Metres to keep between the centres of any two objects.", show_default="0.15"),
    ] = None,
    placement: PlacementFlag = None,
    pack: PackFlag = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is wrong in each line.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, each rejection with its line.")] = False,
) -> None:
    """Check whether the scenes of a file are fair.

    Checks: semantic, geometry, settling (a second of physics), not already solved. The exit code is 1 when a
    scene fails a check or a line is broken.

    For scenes with two or more objects: the shares in which two centres are closer than 0.15 m and 0.05 m,
    and in which footprints overlap. Unless --static, for all scenes whose objects are known, fair or not: the
    shares in which an object moves by more than 5 cm while settling, and in which the task is then solved,
    strictly or by the published criteria.
    """
    if min_distance is not None and not min_distance >= 0:
        raise UsageError(f"--min-distance: expected metres, got {min_distance}")
    keep = load_operators().min_distance if min_distance is None else min_distance
    put = check_choice("placement", placement or PLACEMENTS[0], PLACEMENTS)
    if static and placement:
        raise UsageError("--placement: with --static nothing is put down", hint="leave out one of the two")
    catalogue = load_catalogue(packs=opened(pack))
    with progress() as bar:
        judged = []
        for path in files:
            quick = is_vlatest(path) and not placement if static is None else static
            source = read_scene_file(path, catalogue, frame.value)
            if not (source.lines or source.left_out):
                raise SceneError(f"{path}: no scenes in it", hint="expected one JSON scene a line")
            judged.append(_judge(source, catalogue, keep, bar, None if quick else put))
    _print(judged, json=json, verbose=verbose)
    if missing := sum(bool(PACKED.match(problem.reason)) for file in judged for problem in file.problems):
        stderr().print(f"note: {missing} scenes have objects of packs that were not given: see --pack")
    if any(file.problems for file in judged):
        raise typer.Exit(1)


def _judge(
    source: SceneFile, catalogue: Catalogue, keep: float, bar: Progress, placement: str | None
) -> Verdicts:
    """``placement``: how objects are placed before they settle; None to skip settling."""
    path, problems, crowded = source.path, list[Problem](), list[Crowding | None]()
    known: list[tuple[int, Scene]] = []
    for number, scene in bar.track(source.lines, description=path.name):
        if isinstance(scene, SceneError):
            problems.append(Problem(number, BROKEN, scene.message.removeprefix(f"{path}:{number}: ")))
            continue
        crowded.append(crowding(scene, catalogue))
        if rejection := check_static(scene, catalogue, keep):
            problems.append(Problem(number, rejection.check, rejection.reason))
        if _can_settle(scene, catalogue):
            known.append((number, scene))
    settled = _settle(known, catalogue, placement, bar) if placement else {}
    invalid = {problem.line for problem in problems}
    problems += [
        Problem(number, scene.rejection.check, scene.rejection.reason)
        for number, scene in settled.items()
        if scene.rejection and number not in invalid
    ]
    broken = sum(problem.check == BROKEN for problem in problems)
    return Verdicts(
        path,
        len(source.lines) - broken,
        source.left_out,
        tuple(sorted(problems, key=lambda problem: problem.line)),
        tuple(filter(None, crowded)),
        tuple(settled.values()),
    )


def _can_settle(scene: Scene, catalogue: Catalogue) -> bool:
    ours = not scene.frame and scene.task in TASKS and scene.robot in RIGS
    return ours and is_known(scene.placements, catalogue)


def _settle(
    scenes: list[tuple[int, Scene]], catalogue: Catalogue, placement: str, bar: Progress
) -> dict[int, Settled]:
    from vlafuzz.sim.maniskill.evaluator import settled

    tracked = bar.track(scenes, description="settling")
    return {number: settled(scene, catalogue, placement) for number, scene in tracked}


def _print(judged: list[Verdicts], *, json: bool, verbose: bool) -> None:
    rows = [file.row() for file in judged]
    if json:
        rejections = [[asdict(problem) for problem in file.problems] for file in judged]
        print_json([row | {"rejections": lines} for row, lines in zip(rows, rejections, strict=True)])
        return
    if verbose:
        for file in judged:
            for problem in file.problems:
                typer.echo(f"{file.path}:{problem.line}: {problem.check}: {problem.reason}")
    print_rows(rows, title="scenes")
