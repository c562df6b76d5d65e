"""The scene files of VLATest (FSE 2025), read and written in its own coordinates and names."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from vlafuzz.errors import SceneError

_Number = Annotated[float, Field(allow_inf_nan=False)]
Quaternion = tuple[_Number, _Number, _Number, _Number]  # w, x, y, z


@dataclass(frozen=True)
class Thing:
    """An object by its name there, metres in its frame."""

    model: str
    xy: tuple[float, float]
    quaternion: Quaternion


@dataclass(frozen=True)
class Entry:
    """A scene of a file: its things as they are listed, and which are the targets, the moved one first."""

    things: tuple[Thing, ...]
    targets: tuple[int, ...]

    @property
    def order(self) -> tuple[int, ...]:
        """Places in the list: the targets', then those of the others."""
        return self.targets + tuple(place for place in range(len(self.things)) if place not in self.targets)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _First(_Strict):  # the manipulated object of a grasp scene spells its orientation in its own way
    init_xy: tuple[_Number, _Number]
    orientation: Quaternion


class _Other(_Strict):
    init_xy: tuple[_Number, _Number]
    init_rot_quat: Quaternion


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


_GRASP, _TWO = TypeAdapter(_Grasp), TypeAdapter(_Two)


def is_ycb(path: Path) -> bool:
    """Whether names of a file mean objects of YCB first: some mean an object of another kind elsewhere."""
    return path.name.startswith("ycb_")


def read_entries(path: Path) -> dict[str, Entry]:
    """The scenes of a file by their keys, in order.

    Raises:
        SceneError: the file is not one of its scene files; the message names file and key.
    """
    return {key: _entry(path, key, raw) for key, raw in _scenes(path).items()}


def write_entries(path: Path, entries: Sequence[Entry]) -> None:
    """Write a file, atomically; its seed is that of a name such as ``t-grasp_n-100_o-0_s-170912623.json``."""
    seed = re.search(r"_s-(\d+)$", path.stem)
    scenes = {str(number): _said(entry) for number, entry in enumerate(entries)}
    content = {**scenes, "seed": int(seed[1]) if seed else 0, "num": len(entries)}
    beside = path.with_name(path.name + ".tmp")
    beside.write_text(json.dumps(content), encoding="utf-8")
    beside.replace(path)


def _scenes(path: Path) -> dict[str, object]:
    hint = 'expected an object of scenes under "0", "1", …, with "seed" and "num"'
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text, or nested too deeply"
        there = hint if path.is_file() else "give a file that is there"
        raise SceneError(f"{path}: cannot be read: {reason}", there) from None
    except ValueError as error:  # a number of thousands of digits is one, too
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


def _entry(path: Path, key: str, raw: object) -> Entry:
    """A scene of either schema."""
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


def _of_grasp(scene: _Grasp) -> Entry:
    first = scene.obj_init_options
    others = [_other(model, scene.distractor_obj_init_options) for model in scene.distractor_model_ids]
    return Entry((Thing(scene.model_id, first.init_xy, first.orientation), *others), (0,))


def _of_two(scene: _Two) -> Entry:
    things = tuple(_other(model, scene.obj_init_options) for model in scene.model_ids)
    for name, index in (("source_obj_id", scene.source_obj_id), ("target_obj_id", scene.target_obj_id)):
        if not 0 <= index < len(things):
            raise IndexError(f"{name}: {index} is not the place of one of {len(things)} objects")
    return Entry(things, (scene.source_obj_id, scene.target_obj_id))


def _other(model: str, options: dict[str, _Other]) -> Thing:
    if model not in options:
        raise KeyError(f"there are no options for {model!r}")
    return Thing(model, options[model].init_xy, options[model].init_rot_quat)


def _said(entry: Entry) -> dict[str, Any]:
    names = [thing.model for thing in entry.things]
    options = {
        thing.model: {"init_xy": list(thing.xy), "init_rot_quat": list(thing.quaternion)}
        for thing in entry.things
    }
    if len(entry.targets) > 1:
        ids = {"model_ids": names, "obj_init_options": options}
        return ids | {"source_obj_id": entry.targets[0], "target_obj_id": entry.targets[1]}
    first = options.pop(names[0])
    said: dict[str, Any] = {
        "model_id": names[0],
        "obj_init_options": {"init_xy": first["init_xy"], "orientation": first["init_rot_quat"]},
    }
    if options:
        said |= {"distractor_model_ids": names[1:], "distractor_obj_init_options": options}
    return said
