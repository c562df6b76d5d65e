"""Write scenes as a file of VLATest (FSE 2025), as far as the format can express them."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import EXTRAS, Camera, Light, Placement, Quaternion, Scene
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say
from vlafuzz.worlds.tabletop.vlatest.format import Entry, Thing, is_ycb, write_entries
from vlafuzz.worlds.tabletop.vlatest.original import (
    CUSTOM,
    YCB,
    Counterpart,
    Table,
    as_original,
    bare,
    is_place,
    original_entry,
    original_instruction,
    original_scale,
    our_box,
    vlatest_table,
)
from vlafuzz.worlds.tabletop.vlatest.read import quaternion

NOT_IN_FORMAT = "VLATest's scene files have no "  # light, camera, wording: arguments of its scripts


class _UnsupportedError(Exception):
    """Why the format cannot express a scene."""


def write_vlatest(path: Path, scenes: Sequence[Scene], catalogue: Catalogue) -> dict[str, int]:
    """Write the scenes that the format can express, atomically.

    Positions are stretched from our box onto VLATest's, the inverse of ``fit``; scenes that were imported
    with the frame ``original`` or ``robot`` are written as they were.

    Returns:
        The number of scenes left out, by reason.

    Raises:
        UsageError: the format can express none of them; nothing is written.
    """
    written: list[Entry] = []
    left_out: Counter[str] = Counter()
    for scene in scenes:
        try:
            _check_task(scene)
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


def _check_task(scene: Scene) -> None:
    if scene.task not in TASKS:
        raise _UnsupportedError(f"VLATest has no task {scene.task}")
    if len(scene.targets) != TASKS[scene.task].targets:
        raise _UnsupportedError(f"VLATest has no {scene.task} with {len(scene.targets)} target(s)")


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
    if scene.robot in vlatest_table().original.robots.values():
        raise _UnsupportedError(NOT_IN_FORMAT + f"scenes of the {scene.robot} in another frame than its own")
    table = vlatest_table()
    if unknown := [placed.object for placed in scene.placements if placed.object not in catalogue]:
        raise _UnsupportedError(f"VLATest has no {unknown[0]}")
    spoken = [catalogue[target.object].spoken for target in scene.targets]
    _refuse(scene, say(load_wordings()[scene.task][0], spoken))
    names = _names([placement.object for placement in scene.placements], table.objects)
    things = tuple(
        Thing(name, _there(scene.task, placement, table), _turned(placement, table, name))
        for placement, name in zip(scene.placements, names, strict=True)
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


def _names(objects: Sequence[str], known: Mapping[str, Counterpart]) -> list[str]:
    """VLATest's names, all different: its files keep options by name."""
    names: list[str] = []
    for wanted in objects:
        free = [name for name, ours in known.items() if ours.name == wanted and name not in names]
        if not free:
            raise _UnsupportedError(f"VLATest has no {wanted}" + (" twice" if wanted in objects[:-1] else ""))
        names.append(free[0])
    return names


def _there(task: str, placement: Placement, table: Table) -> tuple[float, float]:
    frame, ours = table.frames[task], our_box()

    def along(value: float, theirs: tuple[float, float], low: float, high: float) -> float:
        return round(sum(theirs) / 2 - (value - (low + high) / 2) * (theirs[1] - theirs[0]) / (high - low), 6)

    x = along(placement.x, frame.x, ours.x.low, ours.x.high)
    return x, along(placement.y, frame.y, ours.y.low, ours.y.high)


def _turned(placement: Placement, table: Table, name: str) -> Quaternion:
    if placement.quaternion is not None or placement.scale != 1.0:
        raise _UnsupportedError(NOT_IN_FORMAT + "rest pose for an object that is turned or scaled freely")
    poses = table.objects[name].poses
    for pose, level in ((poses.level, True), (poses.turned, False)):
        if pose.rest == placement.rest:
            return quaternion(math.radians(placement.yaw - 180.0 - pose.yaw), level=level)
    raise _UnsupportedError(f"VLATest has no {placement.object} that is {placement.rest}")
