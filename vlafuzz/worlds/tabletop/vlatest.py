"""Reads scene files of VLATest (FSE 2025) as scenes of ours, with its robots, objects, sizes and distances."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import first_problem, read_json, read_yaml, validated
from vlafuzz.errors import CatalogueError, SceneError
from vlafuzz.model import Placement, Scene
from vlafuzz.model.scene import MOST, Quaternion, Real, Text
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

CUSTOM, YCB = "custom:", "ycb:"  # prefixes of names, as in packs: YCB and VLATest's own catalogue share some names
_FILE_NAMES = {"t-grasp": "pick-up", "t-move": "move-near", "t-put-on": "put-on", "t-put-in": "put-in"}


class _Strict(BaseModel):
    """Data from outside: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Base(_Strict):
    """The pose of a robot's base: metres, and degrees."""

    x: float
    y: float
    yaw: float


class VlatestTable(_Strict):
    """The facts that VLATest's files leave out, from operators/objects/vlatest.yaml."""

    places: dict[str, str]  # the task by the receptacle that others are put on or into
    robots: dict[str, str]
    bases: dict[str, Base]
    small_tasks: tuple[str, ...]
    small: tuple[str, ...]
    small_scale: float
    unspoken: tuple[str, ...]
    spoken: dict[str, str]


@cache
def vlatest_table() -> VlatestTable:
    """The table, read once."""
    path = operators_dir() / "objects" / "vlatest.yaml"
    return validated(VlatestTable, read_yaml(path, CatalogueError), path, CatalogueError)


# The schemas of the grasp task, and of those with two targets
_Names = Annotated[list[Text], Field(max_length=MOST)]


class _Start(_Strict):  # the key of the orientation differs for the object to grasp
    init_xy: tuple[Real, Real]
    quaternion: Quaternion = Field(validation_alias=AliasChoices("init_rot_quat", "orientation"))


class _Grasp(_Strict):
    model_id: Text
    obj_init_options: _Start
    distractor_model_ids: _Names = Field(default=[])
    distractor_obj_init_options: dict[str, _Start] = Field(default={})


class _Two(_Strict):
    model_ids: _Names
    obj_init_options: dict[str, _Start]
    source_obj_id: int
    target_obj_id: int


_Thing = tuple[str, _Start]  # an object by its name in VLATest, in VLATest's frame
_Entry = tuple[list[_Thing], tuple[int, ...]]  # in file order, and the indices of the targets, the moved one first


def read_vlatest(path: Path) -> list[Scene]:
    """Read a scene file of VLATest; positions are expressed from the robot's base, as our rigs do.

    Names need not be in the catalogue: the packs that have the objects are given later.

    Raises:
        SceneError: not a scene file of VLATest; the message names file and key.
    """
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
    return [_scene(path.name, *_entry(f"{path}: {key}", raw)) for key, raw in scenes.items()]


def _entry(where: str, raw: object) -> _Entry:
    try:
        if isinstance(raw, dict) and "model_id" in raw:
            grasp = _Grasp.model_validate(raw)
            others = _things(where, grasp.distractor_model_ids, grasp.distractor_obj_init_options)
            return [(grasp.model_id, grasp.obj_init_options), *others], (0,)
        two = _Two.model_validate(raw)
    except ValidationError as error:
        raise SceneError(f"{where}: {first_problem(error)}") from None
    things = _things(where, two.model_ids, two.obj_init_options)
    for name, index in (("source_obj_id", two.source_obj_id), ("target_obj_id", two.target_obj_id)):
        if not 0 <= index < len(things):
            raise SceneError(f"{where}: {name}: {index} is not the index of one of {len(things)} objects")
    return things, (two.source_obj_id, two.target_obj_id)


def _things(where: str, models: Sequence[str], options: Mapping[str, _Start]) -> list[_Thing]:
    for model in models:
        if model not in options:
            raise SceneError(f"{where}: there are no options for {model!r}")
    return [(model, options[model]) for model in models]


def _task(file: str, things: Sequence[_Thing], targets: Sequence[int]) -> str:
    """The task by the targets; if these leave it open, by the file's name."""
    if len(targets) == 1:
        return "pick-up"
    by_receptacle = vlatest_table().places.get(things[targets[1]][0])
    named = next((task for word, task in _FILE_NAMES.items() if word in file), None)
    return by_receptacle or (named if named and TASKS[named].targets == 2 else "move-near")


def _scene(file: str, things: Sequence[_Thing], targets: tuple[int, ...]) -> Scene:
    """The scene of an entry: every distance and angle to the robot stays. Receptacles of put tasks are not YCB's."""
    table, task = vlatest_table(), _task(file, things, targets)
    order = [*targets, *(index for index in range(len(things)) if index not in targets)]
    robot, in_order = table.robots[task], order == list(range(len(things)))
    placed = []
    for index, (model, start) in enumerate(things):
        of_ycb = file.startswith("ycb_") and model not in table.places  # the file's name alone tells the catalogue
        small = task in table.small_tasks and (of_ycb or model in table.small)
        x, y, quaternion = _from_base(start, table.bases[task], rig(robot).base)
        scale = table.small_scale if small else 1.0
        placement = Placement((YCB if of_ycb else CUSTOM) + model, "", x, y, quaternion=quaternion, scale=scale)
        placed.append(placement if in_order else replace(placement, listed=index))
    return Scene(
        task,
        tuple(placed[index] for index in targets),
        say(load_wordings()[task][0], [_spoken(things[index][0]) for index in targets]),
        confounders=tuple(placed[index] for index in order[len(targets) :]),
        robot=robot,
    )


def _spoken(model: str) -> str:
    """VLATest's name in instructions: ``opened_7up_can`` is "7up can"."""
    table = vlatest_table()
    words = [word for word in model.split("_") if word not in table.unspoken and not word.endswith("cm")]
    return table.spoken.get(model) or " ".join(words)


def _from_base(start: _Start, base: Base, ours: Sequence[float]) -> tuple[float, float, Quaternion]:
    """Position and orientation of an object in the frame of our rig, whose base is at ``ours``."""
    turn = math.radians(-base.yaw)
    x, y = start.init_xy[0] - base.x, start.init_xy[1] - base.y
    w, i, j, k = start.quaternion
    cos, sin = math.cos(turn / 2), math.sin(turn / 2)
    quaternion = (cos * w - sin * k, cos * i - sin * j, cos * j + sin * i, cos * k + sin * w)
    level = ours[0] + x * math.cos(turn) - y * math.sin(turn), ours[1] + x * math.sin(turn) + y * math.cos(turn)
    return *level, quaternion
