"""The scene files of VLATest (FSE 2025), in VLATest's own coordinates and names."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from vlafuzz.common.files import write_whole
from vlafuzz.common.reading import first_problem, read_json
from vlafuzz.errors import SceneError
from vlafuzz.model.scene import MOST, Quaternion, Real, Text


@dataclass(frozen=True)
class Thing:
    """An object by its name in VLATest; metres in VLATest's frame."""

    model: str
    xy: tuple[float, float]
    quaternion: Quaternion


@dataclass(frozen=True)
class Entry:
    """A scene of a file: its objects in file order, and the indices of the targets, the moved one first."""

    things: tuple[Thing, ...]
    targets: tuple[int, ...]

    @property
    def order(self) -> tuple[int, ...]:
        """Indices of the targets, then of the other objects."""
        return self.targets + tuple(index for index in range(len(self.things)) if index not in self.targets)


_Names = Annotated[list[Text], Field(max_length=MOST)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _First(_Strict):  # the key of the orientation differs for the object to grasp
    init_xy: tuple[Real, Real]
    orientation: Quaternion


class _Other(_Strict):
    init_xy: tuple[Real, Real]
    init_rot_quat: Quaternion


class _Grasp(_Strict):
    model_id: Text
    obj_init_options: _First
    distractor_model_ids: _Names = []
    distractor_obj_init_options: dict[str, _Other] = {}


class _Two(_Strict):
    model_ids: _Names
    obj_init_options: dict[str, _Other]
    source_obj_id: int
    target_obj_id: int


def is_ycb(path: Path) -> bool:
    """Whether the names in a file mean objects of YCB: some names are in both catalogues of VLATest."""
    return path.name.startswith("ycb_")


def read_entries(path: Path) -> dict[str, Entry]:
    """The scenes of a file by key, in order; a SceneError names file and key."""
    return {key: _entry(path, key, raw) for key, raw in _scenes(path).items()}


def write_entries(path: Path, entries: Sequence[Entry]) -> None:
    """Write a file atomically, with the seed of a name such as ``t-grasp_n-100_o-0_s-170912623.json``."""
    seed = re.search(r"_s-(\d+)$", path.stem)
    scenes = {str(number): _to_json(entry) for number, entry in enumerate(entries)}
    content = {**scenes, "seed": int(seed[1]) if seed else 0, "num": len(entries)}
    write_whole(path, json.dumps(content))


def _scenes(path: Path) -> dict[str, object]:
    hint = 'expected a JSON object with scenes under "0", "1", …, "seed" and "num"'
    document = read_json(path, SceneError, hint)
    if not isinstance(document, dict):
        raise SceneError(f"{path}: not a scene file of VLATest, got {type(document).__name__}", hint)
    scenes = {key: value for key, value in document.items() if re.fullmatch("[0-9]{1,9}", key)}
    unknown = [key for key in document if key not in scenes and key not in ("seed", "num")]
    if unknown:
        raise SceneError(f"{path}: {unknown[0]}: unknown key", hint)
    if document.get("num", len(scenes)) != len(scenes):
        raise SceneError(f"{path}: num: says {document['num']!r}, but there are {len(scenes)} scenes")
    return scenes


def _entry(path: Path, key: str, raw: object) -> Entry:
    """A scene in the schema of the grasp task, or of those with two targets."""
    try:
        if isinstance(raw, dict) and "model_id" in raw:
            return _of_grasp(_Grasp.model_validate(raw))
        return _of_two(_Two.model_validate(raw))
    except ValidationError as error:
        raise SceneError(f"{path}: {key}: {first_problem(error)}") from None
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
            raise IndexError(f"{name}: {index} is not the index of one of {len(things)} objects")
    return Entry(things, (scene.source_obj_id, scene.target_obj_id))


def _other(model: str, options: dict[str, _Other]) -> Thing:
    if model not in options:
        raise KeyError(f"there are no options for {model!r}")
    return Thing(model, options[model].init_xy, options[model].init_rot_quat)


def _to_json(entry: Entry) -> dict[str, Any]:
    names = [thing.model for thing in entry.things]
    options = {
        thing.model: {"init_xy": list(thing.xy), "init_rot_quat": list(thing.quaternion)}
        for thing in entry.things
    }
    if len(entry.targets) > 1:
        ids = {"model_ids": names, "obj_init_options": options}
        return ids | {"source_obj_id": entry.targets[0], "target_obj_id": entry.targets[1]}
    first = options.pop(names[0])
    scene: dict[str, Any] = {
        "model_id": names[0],
        "obj_init_options": {"init_xy": first["init_xy"], "orientation": first["init_rot_quat"]},
    }
    if options:
        scene |= {"distractor_model_ids": names[1:], "distractor_obj_init_options": options}
    return scene
