"""The scene files of VLATest (FSE 2025), in VLATest's own coordinates and names."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from vlafuzz.common.files import write_whole
from vlafuzz.common.reading import first_problem, read_json
from vlafuzz.errors import SceneError
from vlafuzz.model.scene import MOST, Quaternion, Real, Text
from vlafuzz.worlds.tabletop.objects.schema import Strict


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


class _First(Strict):  # the key of the orientation differs for the object to grasp
    init_xy: tuple[Real, Real]
    orientation: Quaternion


class _Other(Strict):
    init_xy: tuple[Real, Real]
    init_rot_quat: Quaternion


class _Grasp(Strict):
    model_id: Text
    obj_init_options: _First
    distractor_model_ids: _Names = Field(default=[])
    distractor_obj_init_options: dict[str, _Other] = Field(default={})


class _Two(Strict):
    model_ids: _Names
    obj_init_options: dict[str, _Other]
    source_obj_id: int
    target_obj_id: int


def is_ycb(path: Path) -> bool:
    """Whether the names in a file mean objects of YCB: some names are in both catalogues of VLATest."""
    return path.name.startswith("ycb_")


def read_entries(path: Path) -> dict[str, Entry]:
    """The scenes of a file by key, in order; a SceneError names file and key."""
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
    return {key: _entry(f"{path}: {key}", raw) for key, raw in scenes.items()}


def _entry(where: str, raw: object) -> Entry:
    """A scene in the schema of the grasp task, or of those with two targets."""
    try:
        if isinstance(raw, dict) and "model_id" in raw:
            grasp = _Grasp.model_validate(raw)
            taken = grasp.obj_init_options
            others = _things(where, grasp.distractor_model_ids, grasp.distractor_obj_init_options)
            return Entry((Thing(grasp.model_id, taken.init_xy, taken.orientation), *others), (0,))
        two = _Two.model_validate(raw)
    except ValidationError as error:
        raise SceneError(f"{where}: {first_problem(error)}") from None
    things = _things(where, two.model_ids, two.obj_init_options)
    for name, index in (("source_obj_id", two.source_obj_id), ("target_obj_id", two.target_obj_id)):
        if not 0 <= index < len(things):
            raise SceneError(f"{where}: {name}: {index} is not the index of one of {len(things)} objects")
    return Entry(things, (two.source_obj_id, two.target_obj_id))


def _things(where: str, models: Sequence[str], options: dict[str, _Other]) -> tuple[Thing, ...]:
    for model in models:
        if model not in options:
            raise SceneError(f"{where}: there are no options for {model!r}")
    return tuple(Thing(model, options[model].init_xy, options[model].init_rot_quat) for model in models)


def write_entries(path: Path, entries: Sequence[Entry]) -> None:
    """Write a file atomically, with the seed of a name such as ``t-grasp_n-100_o-0_s-170912623.json``."""
    seed = re.search(r"_s-(\d+)$", path.stem)
    scenes = {str(number): _to_json(entry) for number, entry in enumerate(entries)}
    write_whole(path, json.dumps({**scenes, "seed": int(seed[1]) if seed else 0, "num": len(entries)}))


def _to_json(entry: Entry) -> dict[str, Any]:
    names = [thing.model for thing in entry.things]
    options = {
        thing.model: {"init_xy": list(thing.xy), "init_rot_quat": list(thing.quaternion)} for thing in entry.things
    }
    if len(entry.targets) > 1:
        ids = {"model_ids": names, "obj_init_options": options}
        return ids | {"source_obj_id": entry.targets[0], "target_obj_id": entry.targets[1]}
    first = options.pop(names[0])
    taken = {"init_xy": first["init_xy"], "orientation": first["init_rot_quat"]}
    scene: dict[str, Any] = {"model_id": names[0], "obj_init_options": taken}
    others = {"distractor_model_ids": names[1:], "distractor_obj_init_options": options}
    return scene | others if options else scene
