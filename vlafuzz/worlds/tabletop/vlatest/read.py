"""Read scene files of VLATest (FSE 2025) as scenes of ours."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.errors import SceneError
from vlafuzz.model.scene import Placement, Quaternion, Scene
from vlafuzz.model.scene_lines import SceneFile, is_document, read_scenes
from vlafuzz.worlds.capabilities import Frame, Imported
from vlafuzz.worlds.manipulation.base import Box
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say
from vlafuzz.worlds.tabletop.vlatest.format import Entry, Thing, is_ycb, read_entries
from vlafuzz.worlds.tabletop.vlatest.original import (
    Counterpart,
    Rectangle,
    Table,
    in_robot_frame,
    original_scene,
    our_box,
    vlatest_table,
)

_FILE_NAMES = {"t-grasp": "pick-up", "t-move": "move-near", "t-put-on": "put-on", "t-put-in": "put-in"}


def read_vlatest(path: Path, catalogue: Catalogue, *, frame: Frame = "fit") -> Imported:
    """Read a scene file of VLATest.

    Args:
        frame: ``fit`` stretches VLATest's sampling box onto ours, ``keep`` moves it to the middle of ours;
            ``original`` changes nothing, and ``robot`` only expresses positions from the robot's base, as our
            rigs do. The last two leave no scene out: names need not be in the catalogue.

    Raises:
        SceneError: not a scene file of VLATest; the message names file and key.
    """
    table = vlatest_table()
    entries = read_entries(path)
    tasks = {key: _task(path, entry, table) for key, entry in entries.items()}
    if frame in ("original", "robot"):
        originals = [original_scene(entry, tasks[key], ycb=is_ycb(path)) for key, entry in entries.items()]
        if frame == "robot":
            originals = [in_robot_frame(scene) for scene in originals]
        return Imported(path, len(entries), tuple(map(int, entries)), tuple(originals), {})
    known = table.objects | (table.ycb if is_ycb(path) else {})
    missing: Counter[str] = Counter()
    scenes: dict[int, Scene] = {}
    for key, entry in entries.items():
        absent = {thing.model for thing in entry.things if not _has(catalogue, known.get(thing.model))}
        missing.update(absent)
        if not absent:
            move = _Move(table.frames[tasks[key]], our_box(), stretched=frame == "fit")
            placed = [_placement(path, key, entry.things[i], known, move) for i in entry.order]
            scenes[int(key)] = _scene(tasks[key], placed, catalogue)
    return Imported(path, len(entries), tuple(scenes), tuple(scenes.values()), dict(missing.most_common()))


def _scene(task: str, placed: list[Placement], catalogue: Catalogue) -> Scene:
    targets = tuple(placed[: TASKS[task].targets])
    instruction = say(load_wordings()[task][0], [catalogue[target.object].spoken for target in targets])
    return Scene(task, targets, instruction, confounders=tuple(placed[len(targets) :]))


@dataclass(frozen=True)
class _Move:
    """From VLATest's frame to ours: half a turn about the vertical, then onto our box or to its middle."""

    theirs: Rectangle
    ours: Box
    stretched: bool

    def __call__(self, xy: tuple[float, float]) -> tuple[float, float]:
        return self._along(xy[0], self.theirs.x, self.ours.x.low, self.ours.x.high), self._along(
            xy[1], self.theirs.y, self.ours.y.low, self.ours.y.high
        )

    def _along(self, value: float, theirs: tuple[float, float], low: float, high: float) -> float:
        stretch = (high - low) / (theirs[1] - theirs[0]) if self.stretched else 1.0
        return round((low + high) / 2 - (value - sum(theirs) / 2) * stretch, 6)


def _has(catalogue: Catalogue, counterpart: Counterpart | None) -> bool:
    return counterpart is not None and counterpart.name in catalogue


def _task(path: Path, entry: Entry, table: Table) -> str:
    """The task by the targets; if these leave it open, by the file's name."""
    if len(entry.targets) == 1:
        return "pick-up"
    by_receptacle = table.places.get(entry.things[entry.targets[1]].model)
    named = next((task for word, task in _FILE_NAMES.items() if word in path.name), None)
    return by_receptacle or (named if named and TASKS[named].targets == 2 else "move-near")


def _placement(
    path: Path, key: str, thing: Thing, known: Mapping[str, Counterpart], move: _Move
) -> Placement:
    counterpart = known[thing.model]
    w, x, y, z = thing.quaternion
    level = math.hypot(x, y) < 1e-3
    yaw = 2 * math.atan2(z, w)
    expected = quaternion(yaw, level=level)
    if not level and abs(sum(a * b for a, b in zip(thing.quaternion, expected, strict=True))) < 1 - 1e-6:
        problem = f"orientation {thing.quaternion} is neither upright nor level"
        raise SceneError(f"{path}: {key}: {thing.model}: {problem}")
    pose = counterpart.poses.level if level else counterpart.poses.turned
    turned = math.degrees(yaw) + pose.yaw + 180.0
    wrapped = 180.0 - (180.0 - turned) % 360.0  # in (-180, 180]
    return Placement(counterpart.name, pose.rest, *move(thing.xy), round(wrapped, 4))


def quaternion(yaw: float, *, level: bool) -> Quaternion:
    """(w, x, y, z): a quarter turn about x unless ``level``, then ``yaw`` radians about the vertical."""
    half, lean = yaw / 2, 0.0 if level else math.pi / 4
    return (
        math.cos(half) * math.cos(lean),
        math.cos(half) * math.sin(lean),
        math.sin(half) * math.sin(lean),
        math.sin(half) * math.cos(lean),
    )


def read_scene_file(path: Path, catalogue: Catalogue, frame: Frame) -> SceneFile:
    """Read a file of scenes, ours or VLATest's; for ``frame`` see ``read_vlatest``."""
    if not is_document(path):
        return SceneFile(path, tuple(read_scenes(path)))
    imported = read_vlatest(path, catalogue, frame=frame)
    return SceneFile(path, tuple(zip(imported.numbers, imported.scenes, strict=True)), imported.left_out)
