"""Scenes of other systems, read as ours: so far the files of VLATest (FSE 2025)."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from vlafuzz.errors import CatalogueError, SceneError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Placement, Scene
from vlafuzz.shipped import operators_dir
from vlafuzz.space.catalogue import load_operators
from vlafuzz.space.operators import TargetPosition
from vlafuzz.space.ranges import Box
from vlafuzz.tasks.instructions import load_wordings, say
from vlafuzz.tasks.tabletop import TASKS

Frame = Literal["fit", "keep"]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Quaternion = tuple[_Number, _Number, _Number, _Number]  # w, x, y, z
_FILE_NAMES = {"t-grasp": "pick-up", "t-move": "move-near", "t-put-on": "put-on", "t-put-in": "put-in"}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _First(_Strict):  # the manipulated object of a grasp scene spells its orientation in its own way
    init_xy: tuple[_Number, _Number]
    orientation: _Quaternion


class _Other(_Strict):
    init_xy: tuple[_Number, _Number]
    init_rot_quat: _Quaternion


class _Grasp(_Strict):
    model_id: str
    obj_init_options: _First
    distractor_model_ids: list[str] = []
    distractor_obj_init_options: dict[str, _Other] = {}


class _Two(_Strict):
    model_ids: list[str]
    obj_init_options: dict[str, _Other]
    source_obj_id: int
    target_obj_id: int


class _Pose(_Strict):
    rest: str
    yaw: float = 0.0


class _Poses(_Strict):
    turned: _Pose
    level: _Pose


class Counterpart(_Strict):
    """What an object of theirs is among ours."""

    name: str
    poses: _Poses


class _Frame(_Strict):
    x: tuple[float, float]
    y: tuple[float, float]


class Table(_Strict):
    """operators/objects/vlatest.yaml."""

    frames: dict[str, _Frame]
    places: dict[str, str]
    objects: dict[str, Counterpart]
    ycb: dict[str, Counterpart]


@dataclass(frozen=True)
class _Thing:
    model: str
    xy: tuple[float, float]
    quaternion: _Quaternion


@dataclass(frozen=True)
class Imported:
    """What came of a file.

    Attributes:
        read: number of scenes in it.
        missing: names without a counterpart of ours, and how many scenes have each; a scene may have several.
    """

    path: Path
    read: int
    scenes: tuple[Scene, ...]
    missing: dict[str, int]

    @property
    def left_out(self) -> int:
        """Number of scenes with an object that has no counterpart."""
        return self.read - len(self.scenes)


def read_vlatest(path: Path, catalogue: Catalogue, *, frame: Frame = "fit") -> Imported:
    """Read a scene file of VLATest.

    Args:
        frame: ``fit`` stretches its sampling box onto ours, ``keep`` moves it to the middle of ours.

    Raises:
        SceneError: the file is not one of its scene files; the message names file and key.
    """
    table = vlatest_table()
    known = table.objects | (table.ycb if path.name.startswith("ycb_") else {})
    named = next((task for word, task in _FILE_NAMES.items() if word in path.name), None)
    missing: Counter[str] = Counter()
    scenes = []
    entries = _entries(path)
    for key, raw in entries.items():
        targets, others = _things(path, key, raw)
        absent = {thing.model for thing in targets + others if not _has(catalogue, known.get(thing.model))}
        missing.update(absent)
        if absent:
            continue
        task = _task(table, targets, named)
        move = _Move(table.frames[task], our_box(), frame)
        placed = [_placement(path, key, thing, known[thing.model], move) for thing in targets + others]
        spoken = [catalogue[placement.object].spoken for placement in placed[: len(targets)]]
        instruction = say(load_wordings()[task][0], spoken)
        scenes.append(Scene(task, tuple(placed[: len(targets)]), instruction, tuple(placed[len(targets) :])))
    return Imported(path, len(entries), tuple(scenes), dict(missing.most_common()))


@dataclass(frozen=True)
class _Move:
    """From its frame to ours: half a turn about the vertical, then onto our box or to its middle."""

    theirs: _Frame
    ours: Box
    frame: Frame

    def __call__(self, xy: tuple[float, float]) -> tuple[float, float]:
        return self._along(xy[0], self.theirs.x, self.ours.x.low, self.ours.x.high), self._along(
            xy[1], self.theirs.y, self.ours.y.low, self.ours.y.high
        )

    def _along(self, value: float, theirs: tuple[float, float], low: float, high: float) -> float:
        stretch = (high - low) / (theirs[1] - theirs[0]) if self.frame == "fit" else 1.0
        return round((low + high) / 2 - (value - sum(theirs) / 2) * stretch, 6)


@cache
def vlatest_table() -> Table:
    """Its names, poses and boxes as ours.

    Raises:
        CatalogueError: the table is damaged.
    """
    path = operators_dir() / "objects" / "vlatest.yaml"
    try:
        return Table.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except (OSError, yaml.YAMLError, ValidationError) as error:
        raise CatalogueError(f"{path}: {' '.join(str(error).split())}") from None


@cache
def our_box() -> Box:
    """Where our targets stand by default."""
    position = load_operators().get(TargetPosition)
    return Box(x=position.x, y=position.y)


def _has(catalogue: Catalogue, counterpart: Counterpart | None) -> bool:
    return counterpart is not None and counterpart.name in catalogue


def _entries(path: Path) -> dict[str, object]:
    """The scenes of a file by their keys, in order."""
    hint = 'expected an object of scenes under "0", "1", …, with "seed" and "num"'
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise SceneError(f"{path}: cannot be read: {reason}", hint) from None
    except json.JSONDecodeError as error:
        raise SceneError(f"{path}: not JSON: {error}", hint) from None
    if not isinstance(found, dict):
        raise SceneError(f"{path}: not a scene file of VLATest, got {type(found).__name__}", hint)
    scenes = {key: value for key, value in found.items() if key.isdecimal()}
    unknown = [key for key in found if key not in scenes and key not in ("seed", "num")]
    if unknown:
        raise SceneError(f"{path}: {unknown[0]}: unknown key", hint)
    if found.get("num", len(scenes)) != len(scenes):
        raise SceneError(f"{path}: num: says {found['num']!r}, but there are {len(scenes)} scenes")
    return scenes


_GRASP, _TWO = TypeAdapter(_Grasp), TypeAdapter(_Two)


def _things(path: Path, key: str, raw: object) -> tuple[list[_Thing], list[_Thing]]:
    """The targets and the others of a scene of either schema."""
    try:
        if isinstance(raw, dict) and "model_id" in raw:
            return _of_grasp(_GRASP.validate_python(raw))
        return _of_two(_TWO.validate_python(raw))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join([key, *map(str, problem["loc"])])
        raise SceneError(f"{path}: {where}: {problem['msg'].lower()}") from None
    except (KeyError, IndexError) as error:
        raise SceneError(f"{path}: {key}: {error.args[0]}") from None


def _of_grasp(scene: _Grasp) -> tuple[list[_Thing], list[_Thing]]:
    first = scene.obj_init_options
    others = [_other(model, scene.distractor_obj_init_options) for model in scene.distractor_model_ids]
    return [_Thing(scene.model_id, first.init_xy, first.orientation)], others


def _of_two(scene: _Two) -> tuple[list[_Thing], list[_Thing]]:
    things = [_other(model, scene.obj_init_options) for model in scene.model_ids]
    for name, index in (("source_obj_id", scene.source_obj_id), ("target_obj_id", scene.target_obj_id)):
        if not 0 <= index < len(things):
            raise IndexError(f"{name}: {index} is not the place of one of {len(things)} objects")
    chosen = [scene.source_obj_id, scene.target_obj_id]
    return [things[index] for index in chosen], [
        thing for index, thing in enumerate(things) if index not in chosen
    ]


def _other(model: str, options: dict[str, _Other]) -> _Thing:
    if model not in options:
        raise KeyError(f"there are no options for {model!r}")
    return _Thing(model, options[model].init_xy, options[model].init_rot_quat)


def _task(table: Table, targets: list[_Thing], named: str | None) -> str:
    """The task, from what the targets are; the file's name decides where that leaves it open."""
    if len(targets) == 1:
        return "pick-up"
    told = table.places.get(targets[1].model)
    return told or (named if named and TASKS[named].targets == 2 else "move-near")


def _placement(path: Path, key: str, thing: _Thing, counterpart: Counterpart, move: _Move) -> Placement:
    w, x, y, z = thing.quaternion
    level = math.hypot(x, y) < 1e-3
    yaw = 2 * math.atan2(z, w)
    expected = quaternion(yaw, level=level)
    if not level and abs(sum(a * b for a, b in zip(thing.quaternion, expected, strict=True))) < 1 - 1e-6:
        raise SceneError(
            f"{path}: {key}: {thing.model}: orientation {thing.quaternion} is neither upright nor level"
        )
    pose = counterpart.poses.level if level else counterpart.poses.turned
    turned = math.degrees(yaw) + pose.yaw + 180.0
    wrapped = 180.0 - (180.0 - turned) % 360.0  # in (-180, 180]
    return Placement(counterpart.name, pose.rest, *move(thing.xy), round(wrapped, 4))


def quaternion(yaw: float, *, level: bool) -> _Quaternion:
    """(w, x, y, z): a quarter turn about x, or none, and then ``yaw`` radians about the vertical."""
    half, lean = yaw / 2, 0.0 if level else math.pi / 4
    return (
        math.cos(half) * math.cos(lean),
        math.cos(half) * math.sin(lean),
        math.sin(half) * math.sin(lean),
        math.sin(half) * math.cos(lean),
    )
