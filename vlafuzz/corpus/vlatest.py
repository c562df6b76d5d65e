"""Our scenes as a file of VLATest (FSE 2025), as far as it can say them: the inverse of ``interchange``."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vlafuzz.corpus.interchange import Counterpart, Table, our_box, quaternion, vlatest_table
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Camera, Light, Placement, Scene
from vlafuzz.tasks.instructions import load_wordings, say

UNSAID = "VLATest's scene files have no "  # light, camera, wording: arguments of its scripts


class _UnsaidError(Exception):
    """Why a scene cannot be said."""


def write_vlatest(path: Path, scenes: Sequence[Scene], catalogue: Catalogue) -> dict[str, int]:
    """Write what can be said, atomically; positions from our box onto theirs, as ``fit`` reads them.

    Returns:
        How many scenes are left out, by reason.
    """
    written: list[dict[str, Any]] = []
    unsaid: Counter[str] = Counter()
    for scene in scenes:
        try:
            written.append(_said(scene, vlatest_table(), catalogue))
        except _UnsaidError as error:
            unsaid[str(error)] += 1
    content = {str(number): scene for number, scene in enumerate(written)}
    beside = path.with_name(path.name + ".tmp")
    beside.write_text(json.dumps({**content, "seed": 0, "num": len(written)}), encoding="utf-8")
    beside.replace(path)
    return dict(unsaid)


def _said(scene: Scene, table: Table, catalogue: Catalogue) -> dict[str, Any]:
    spoken = [catalogue[target.object].spoken for target in scene.targets]
    differs = {
        "light": scene.light != Light(),
        "camera": scene.camera != Camera(),
        "wording": scene.instruction != say(load_wordings()[scene.task][0], spoken),
    }
    for name in (name for name, differs in differs.items() if differs):
        raise _UnsaidError(UNSAID + name)
    names = _names([placement.object for placement in scene.placements], table.objects)
    options = [
        {"init_xy": _there(scene.task, placement, table), "init_rot_quat": _turned(placement, table, name)}
        for placement, name in zip(scene.placements, names, strict=True)
    ]
    if len(scene.targets) > 1:
        things = dict(zip(names, options, strict=True))
        return {"model_ids": names, "obj_init_options": things, "source_obj_id": 0, "target_obj_id": 1}
    first = {"init_xy": options[0]["init_xy"], "orientation": options[0]["init_rot_quat"]}
    said: dict[str, Any] = {"model_id": names[0], "obj_init_options": first}
    if scene.confounders:
        others = dict(zip(names[1:], options[1:], strict=True))
        said |= {"distractor_model_ids": names[1:], "distractor_obj_init_options": others}
    return said


def _names(objects: Sequence[str], known: Mapping[str, Counterpart]) -> list[str]:
    """Their names, each once: options are kept by name there."""
    names: list[str] = []
    for wanted in objects:
        theirs = [name for name, ours in known.items() if ours.name == wanted and name not in names]
        if not theirs:
            raise _UnsaidError(f"VLATest has no {wanted}" + (" twice" if wanted in objects[:-1] else ""))
        names.append(theirs[0])
    return names


def _there(task: str, placement: Placement, table: Table) -> list[float]:
    frame, ours = table.frames[task], our_box()

    def along(value: float, theirs: tuple[float, float], low: float, high: float) -> float:
        return round(sum(theirs) / 2 - (value - (low + high) / 2) * (theirs[1] - theirs[0]) / (high - low), 6)

    return [
        along(placement.x, frame.x, ours.x.low, ours.x.high),
        along(placement.y, frame.y, ours.y.low, ours.y.high),
    ]


def _turned(placement: Placement, table: Table, name: str) -> list[float]:
    if placement.quaternion is not None or placement.scale != 1.0:
        raise _UnsaidError(UNSAID + "rest pose for an object that is turned or scaled freely")
    poses = table.objects[name].poses
    for pose, level in ((poses.level, True), (poses.turned, False)):
        if pose.rest == placement.rest:
            return list(quaternion(math.radians(placement.yaw - 180.0 - pose.yaw), level=level))
    raise _UnsaidError(f"VLATest has no {placement.object} that is {placement.rest}")
