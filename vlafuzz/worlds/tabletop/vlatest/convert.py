"""Reads scene files of VLATest (FSE 2025) as scenes of ours, and writes scenes as far as the format can."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model.scene import EXTRAS, Camera, Light, Placement, Quaternion, Scene
from vlafuzz.model.scene_lines import SceneFile, is_document, read_scenes
from vlafuzz.worlds.capabilities import Frame, Imported
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import TargetPosition
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say
from vlafuzz.worlds.tabletop.vlatest.format import Entry, Thing, is_ycb, read_entries, write_entries
from vlafuzz.worlds.tabletop.vlatest.original import (
    CUSTOM,
    YCB,
    Counterpart,
    as_original,
    bare,
    in_robot_frame,
    is_place,
    original_entry,
    original_instruction,
    original_scale,
    original_scene,
    vlatest_table,
)

_FILE_NAMES = {"t-grasp": "pick-up", "t-move": "move-near", "t-put-on": "put-on", "t-put-in": "put-in"}
NOT_IN_FORMAT = "VLATest's scene files have no "  # light, camera, wording: arguments of its scripts


def read_scene_file(path: Path, catalogue: Catalogue, frame: Frame) -> SceneFile:
    """Read a file of scenes, ours or VLATest's; for ``frame`` see ``read_vlatest``."""
    if not is_document(path):
        return SceneFile(path, tuple(read_scenes(path)))
    imported = read_vlatest(path, catalogue, frame=frame)
    return SceneFile(path, tuple(zip(imported.numbers, imported.scenes, strict=True)), imported.left_out)


def read_vlatest(path: Path, catalogue: Catalogue, *, frame: Frame = "fit") -> Imported:
    """Read a scene file of VLATest.

    Args:
        frame: ``fit`` stretches VLATest's sampling box onto ours, ``keep`` moves it to the middle of ours; ``original``
            changes nothing, and ``robot`` only expresses positions from the robot's base, as our rigs do. The last two
            leave no scene out: names need not be in the catalogue.

    Raises:
        SceneError: not a scene file of VLATest; the message names file and key.
    """
    table, entries = vlatest_table(), read_entries(path)
    known = table.objects | (table.ycb if is_ycb(path) else {})
    missing: Counter[str] = Counter()
    scenes: dict[int, Scene] = {}
    for key, entry in entries.items():
        task = _task(path, entry)
        if frame in ("original", "robot"):
            original = original_scene(entry, task, ycb=is_ycb(path))
            scenes[int(key)] = in_robot_frame(original) if frame == "robot" else original
            continue
        absent = {
            thing.model
            for thing in entry.things
            if thing.model not in known or known[thing.model].name not in catalogue
        }
        missing.update(absent)
        if not absent:
            placed = [
                _placement(f"{path}: {key}", entry.things[i], known, task, stretched=frame == "fit")
                for i in entry.order
            ]
            targets = tuple(placed[: TASKS[task].targets])
            instruction = _nominal(task, targets, catalogue)
            scenes[int(key)] = Scene(task, targets, instruction, confounders=tuple(placed[len(targets) :]))
    return Imported(path, len(entries), tuple(scenes), tuple(scenes.values()), dict(missing.most_common()))


def _task(path: Path, entry: Entry) -> str:
    """The task by the targets; if these leave it open, by the file's name."""
    if len(entry.targets) == 1:
        return "pick-up"
    by_receptacle = vlatest_table().places.get(entry.things[entry.targets[1]].model)
    named = next((task for word, task in _FILE_NAMES.items() if word in path.name), None)
    return by_receptacle or (named if named and TASKS[named].targets == 2 else "move-near")


def _nominal(task: str, targets: Sequence[Placement], catalogue: Catalogue) -> str:
    return say(load_wordings()[task][0], [catalogue[target.object].spoken for target in targets])


def _placement(where: str, thing: Thing, known: Mapping[str, Counterpart], task: str, *, stretched: bool) -> Placement:
    counterpart = known[thing.model]
    w, i, j, z = thing.quaternion
    level = math.hypot(i, j) < 1e-3
    yaw = 2 * math.atan2(z, w)
    expected = _quaternion(yaw, level=level)
    if not level and abs(sum(a * b for a, b in zip(thing.quaternion, expected, strict=True))) < 1 - 1e-6:
        problem = f"orientation {thing.quaternion} is neither upright nor level"
        raise SceneError(f"{where}: {thing.model}: {problem}")
    pose = counterpart.poses.level if level else counterpart.poses.turned
    turned = math.degrees(yaw) + pose.yaw + 180.0
    wrapped = 180.0 - (180.0 - turned) % 360.0  # in (-180, 180]
    x, y = _here(task, thing.xy, stretched=stretched)
    return Placement(counterpart.name, pose.rest, x, y, round(wrapped, 4))


def _quaternion(yaw: float, *, level: bool) -> Quaternion:
    """(w, x, y, z): a quarter turn about x unless ``level``, then ``yaw`` radians about the vertical."""
    half, lean = yaw / 2, 0.0 if level else math.pi / 4
    return (
        math.cos(half) * math.cos(lean),
        math.cos(half) * math.sin(lean),
        math.sin(half) * math.sin(lean),
        math.sin(half) * math.cos(lean),
    )


def _boxes(task: str) -> list[tuple[float, float, float, float]]:
    """Along x and along y: the ends of VLATest's sampling box, and of the range of our targets' positions."""
    theirs, ours = vlatest_table().frames[task], load_operators().get(TargetPosition)
    return [(*theirs.x, ours.x.low, ours.x.high), (*theirs.y, ours.y.low, ours.y.high)]


def _here(task: str, place: Sequence[float], *, stretched: bool) -> list[float]:
    """From VLATest's frame to ours: half a turn about the vertical, then onto our box or to its middle."""
    moved = []
    for at, (near, far, low, high) in zip(place, _boxes(task), strict=True):
        stretch = (high - low) / (far - near) if stretched else 1.0
        moved.append(round((low + high) / 2 - (at - (near + far) / 2) * stretch, 6))
    return moved


def _there(task: str, place: Sequence[float]) -> tuple[float, float]:
    """The inverse of ``_here``, stretched."""
    x, y = (
        round((near + far) / 2 - (at - (low + high) / 2) * (far - near) / (high - low), 6)
        for at, (near, far, low, high) in zip(place, _boxes(task), strict=True)
    )
    return x, y


class _UnsupportedError(Exception):
    """Why the format cannot express a scene."""


def write_vlatest(path: Path, scenes: Sequence[Scene], catalogue: Catalogue) -> dict[str, int]:
    """Write the scenes that the format can express, atomically.

    Positions are stretched from our box onto VLATest's, the inverse of ``fit``; scenes that were imported with the
    frame ``original`` or ``robot`` are written as they were.

    Returns:
        The number of scenes left out, by reason.

    Raises:
        UsageError: the format can express none of them; nothing is written.
    """
    written: list[Entry] = []
    left_out: Counter[str] = Counter()
    for scene in scenes:
        try:
            if scene.task not in TASKS:
                raise _UnsupportedError(f"VLATest has no task {scene.task}")
            if len(scene.targets) != TASKS[scene.task].targets:
                raise _UnsupportedError(f"VLATest has no {scene.task} with {len(scene.targets)} target(s)")
            original = as_original(scene)
            written.append(_original(original, ycb=is_ycb(path)) if original else _fit(scene, catalogue))
        except _UnsupportedError as error:
            left_out[str(error)] += 1
    if left_out and not written:
        why = "; ".join(f"{count}: {reason}" for reason, count in left_out.items())
        vary = "target-type,target-position,confounder-type,confounder-position,confounder-count"
        raise UsageError(
            f"none of {len(scenes)} scenes can be written for VLATest: {why}",
            hint=f"`vlafuzz run --vary {vary}` finds scenes that can",
        )
    write_entries(path, written)
    return dict(left_out)


def _original(scene: Scene, *, ycb: bool) -> Entry:
    _refuse(scene, original_instruction(scene.task, [bare(target.object) for target in scene.targets]))
    for placement in scene.placements:
        if not placement.object.startswith((CUSTOM, YCB)):
            raise _UnsupportedError(f"VLATest has no {placement.object}")
        if placement.object.startswith(YCB) != (ycb and not is_place(placement.object)):
            reason = "VLATest keeps objects of YCB in files of their own, named ycb_…: see --out"
            raise _UnsupportedError(reason)
        if placement.quaternion is None:
            raise _UnsupportedError(NOT_IN_FORMAT + "rest poses")
        if placement.scale != original_scale(scene.task, placement.object):
            raise _UnsupportedError(NOT_IN_FORMAT + "sizes")
    if len({placement.object for placement in scene.placements}) < len(scene.placements):
        raise _UnsupportedError("VLATest has no object twice")
    return original_entry(scene)


def _fit(scene: Scene, catalogue: Catalogue) -> Entry:
    table = vlatest_table()
    if scene.robot in table.original.robots.values():
        raise _UnsupportedError(NOT_IN_FORMAT + f"scenes of the {scene.robot} in another frame than its own")
    if unknown := [placed.object for placed in scene.placements if placed.object not in catalogue]:
        raise _UnsupportedError(f"VLATest has no {unknown[0]}")
    _refuse(scene, _nominal(scene.task, scene.targets, catalogue))
    things = tuple(
        Thing(name, _there(scene.task, (placed.x, placed.y)), _turned(placed, table.objects[name]))
        for name, placed in zip(_names(scene, table.objects), scene.placements, strict=True)
    )
    return Entry(things, tuple(range(len(scene.targets))))


def _refuse(scene: Scene, instruction: str) -> None:
    """Refuse light, camera, wording and extras, which VLATest's files do not have."""
    differs = {
        "light": scene.light != Light(),
        "camera": scene.camera != Camera(),
        "wording": scene.instructions != (instruction,),
        **{part.replace("_", " "): getattr(scene, part) != nominal for part, nominal in EXTRAS.items()},
    }
    for name, not_nominal in differs.items():
        if not_nominal:
            raise _UnsupportedError(NOT_IN_FORMAT + name)


def _names(scene: Scene, known: Mapping[str, Counterpart]) -> list[str]:
    """VLATest's names, all different: its files keep options by name."""
    names: list[str] = []
    objects = [placement.object for placement in scene.placements]
    for wanted in objects:
        free = [name for name, ours in known.items() if ours.name == wanted and name not in names]
        if not free:
            raise _UnsupportedError(f"VLATest has no {wanted}" + (" twice" if wanted in objects[:-1] else ""))
        names.append(free[0])
    return names


def _turned(placement: Placement, counterpart: Counterpart) -> Quaternion:
    if placement.quaternion is not None or placement.scale != 1.0:
        raise _UnsupportedError(NOT_IN_FORMAT + "rest pose for an object that is turned or scaled freely")
    for pose, level in ((counterpart.poses.level, True), (counterpart.poses.turned, False)):
        if pose.rest == placement.rest:
            return _quaternion(math.radians(placement.yaw - 180.0 - pose.yaw), level=level)
    raise _UnsupportedError(f"VLATest has no {placement.object} that is {placement.rest}")
