"""How much of the space scenes cover: places of the first object, as in the paper, and behaviour."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import is_store
from vlafuzz.search.scoring import cell
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.capabilities import Frame
from vlafuzz.worlds.manipulation.operator_set import stored_operators
from vlafuzz.worlds.manipulation.operators import TargetPosition
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue, stored_catalogue
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.worlds.tabletop.vlatest import FRAME, Rectangle, read_scene_file, vlatest_table

SIDE = 10  # cells along x and along y, of the box from which positions are drawn
SIZES = (10, 100, 1000)  # the paper's
_ROUNDING = 1e-6  # metres, of imported positions


class Step(NamedTuple):
    """What coverage needs of a scene.

    Attributes:
        place: the cell of the box that has its first object; None outside.
        site: the operators far from nominal, and the target's place; None if unknown.
        cell: its site with the stage at which the policy was lost, if the scene was run.
    """

    place: tuple[int, int] | None
    site: str | None
    cell: str | None = None
    failed: bool = False


@dataclass(frozen=True)
class Track:
    """The scenes of one task of a file, or of one run of a store, in order."""

    task: str
    steps: tuple[Step, ...]
    run: int | None = None
    strategy: str | None = None


@dataclass(frozen=True, kw_only=True)
class Covered:
    """What the first ``scenes`` of a track cover.

    Attributes:
        positions: share of the 10 × 10 cells of the box.
        sites: number of distinct sites; None if unknown.
        cells, failures: distinct cells of all rollouts and of failed ones; None if nothing was run.
    """

    task: str
    scenes: int
    positions: float
    sites: int | None
    cells: int | None
    failures: int | None


def tracks_of_files(
    paths: Iterable[Path], operators: str | None, frame: Frame, note: Callable[[str], None]
) -> Iterator[tuple[Path, list[Track]]]:
    """The tracks of files of scenes and of stores; ``operators``: the ranges that scenes are measured in."""
    catalogue, ranges = load_catalogue(), load_operators(operators)
    for path in paths:
        if is_store(path):
            with Store.open(path) as store:
                yield path, tracks_of_store(store)
            continue
        source = read_scene_file(path, catalogue, frame)
        if source.left_out:
            note(f"{path}: {source.left_out} scenes are left out: they have unknown objects")
        yield path, tracks_of_scenes(source.scenes(), ranges, catalogue)


def tracks_of_scenes(scenes: Iterable[Scene], operators: OperatorSet, catalogue: Catalogue) -> list[Track]:
    """A track per task and robot, in order of first appearance."""
    by_kind: dict[tuple[str, str], list[Scene]] = {}
    for scene in scenes:
        by_kind.setdefault((scene.task, scene.robot), []).append(scene)
    tracks = []
    for (task, _), alike in by_kind.items():
        space = _space(operators, catalogue, alike[0])
        tracks.append(Track(task, tuple(_step(scene, space) for scene in alike)))
    return tracks


def tracks_of_store(store: Store) -> list[Track]:
    """A track per run: its judged trials, including those that reused an outcome."""
    return [_run_track(store, run) for run in store.runs()]


def covered(track: Track, sizes: Sequence[int] = SIZES) -> Iterator[Covered]:
    """Coverage by the first scenes of a track, for each size that it has, and by all scenes."""
    total = len(track.steps)
    for size in [*sorted({size for size in sizes if size < total}), total]:
        steps = track.steps[:size]
        run = [step for step in steps if step.cell]
        sites = {step.site for step in steps}
        yield Covered(
            task=track.task,
            scenes=size,
            positions=len({step.place for step in steps if step.place}) / SIDE**2,
            sites=None if None in sites else len(sites),
            cells=len({step.cell for step in run}) if run else None,
            failures=len({step.cell for step in run if step.failed}) if run else None,
        )


def place(x: float, y: float, area: Rectangle) -> tuple[int, int] | None:
    """The cell of a point; None outside."""
    column, row = _along(x, area.x), _along(y, area.y)
    return None if column is None or row is None else (column, row)


def _along(value: float, bounds: tuple[float, float]) -> int | None:
    low, high = bounds
    if not low - _ROUNDING <= value <= high + _ROUNDING:
        return None
    return 0 if high == low else min(max(int((value - low) / (high - low) * SIDE), 0), SIDE - 1)


def _space(operators: OperatorSet, catalogue: Catalogue, scene: Scene) -> SearchSpace:
    """The search space of scenes like this one; only the task of VLATest's scenes matters."""
    robot = () if scene.frame == FRAME else (scene.robot,)
    return SearchSpace(operators, catalogue, scene.task, *robot)


def _step(scene: Scene, space: SearchSpace) -> Step:
    if scene.frame == FRAME:
        first, area, site = scene.listing[0], vlatest_table().drawn_from(scene.task), None
    else:
        drawn = space.operators.get(TargetPosition)
        area = Rectangle(x=(drawn.x.low, drawn.x.high), y=(drawn.y.low, drawn.y.high))
        first, site = scene.listing[0], space.site(scene, space.severities(scene))
    return Step(place(first.x, first.y, area), site)


def _run_track(store: Store, run: Run) -> Track:
    manifest, steps = run.manifest, []
    judged = [trial for trial in store.trials(run.id) if trial.outcome.verdict >= Verdict.PASSED]
    if judged:
        operators, catalogue = stored_operators(store.path, manifest), stored_catalogue(manifest)
        space = _space(operators, catalogue, judged[0].scene)
    for trial in judged:
        reached = cell(trial.scene, trial.outcome, space.severities(trial.scene), space)
        failed = trial.outcome.verdict is Verdict.FAILED
        steps.append(_step(trial.scene, space)._replace(cell=reached, failed=failed))
    return Track(manifest.task, tuple(steps), run.id, manifest.strategy)
