"""Reads scene files of VLATest (FSE 2025) as scenes of ours: on our table, or with its robots, objects and sizes."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import first_problem, read_json, read_yaml, validated
from vlafuzz.errors import CatalogueError, SceneError
from vlafuzz.model.scene import MOST, Placement, Quaternion, Real, Scene, Text
from vlafuzz.model.scene_lines import Frame
from vlafuzz.worlds.base import Imported
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import TargetPosition
from vlafuzz.worlds.manipulation.rigs import Workspace, rig
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

CUSTOM, YCB = "custom:", "ycb:"  # prefixes of names, as in packs: YCB and VLATest's own catalogue share some names
_FILE_NAMES = {"t-grasp": "pick-up", "t-move": "move-near", "t-put-on": "put-on", "t-put-in": "put-in"}


class _Strict(BaseModel):
    """Data from outside: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _Pose(_Strict):
    rest: str
    yaw: float = 0.0


class Counterpart(_Strict):
    """The object of ours that stands for one of VLATest's."""

    name: str
    poses: dict[Literal["turned", "level"], _Pose]


class Base(_Strict):
    """The pose of a robot's base: metres, and degrees."""

    x: float
    y: float
    yaw: float


class Original(_Strict):
    """The facts that VLATest's files leave out: robots by task, sizes, and names in instructions."""

    robots: dict[str, str]
    bases: dict[str, Base]
    small_tasks: tuple[str, ...]
    small: tuple[str, ...]
    small_scale: float
    unspoken: tuple[str, ...]
    spoken: dict[str, str]


class VlatestTable(_Strict):
    """The content of operators/objects/vlatest.yaml."""

    frames: dict[str, Workspace]
    places: dict[str, str]  # the task by the receptacle that others are put on or into
    objects: dict[str, Counterpart]
    ycb: dict[str, Counterpart]
    original: Original


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


@dataclass(frozen=True)
class _Thing:
    """An object by its name in VLATest; metres in VLATest's frame."""

    model: str
    xy: tuple[float, float]
    quaternion: Quaternion


@dataclass(frozen=True)
class _Entry:
    """A scene of a file: its objects in file order, and the indices of the targets, the moved one first."""

    things: tuple[_Thing, ...]
    targets: tuple[int, ...]

    @property
    def order(self) -> tuple[int, ...]:
        """Indices of the targets, then of the other objects."""
        return self.targets + tuple(index for index in range(len(self.things)) if index not in self.targets)


def read_vlatest(path: Path, catalogue: Catalogue, *, frame: Frame = "fit") -> Imported:
    """Read a scene file of VLATest.

    Args:
        frame: ``fit`` stretches VLATest's sampling box onto ours; ``robot`` keeps robots, objects, sizes and distances,
            and only expresses positions from the robot's base, as our rigs do. It leaves no scene out: names need not
            be in the catalogue.

    Raises:
        SceneError: not a scene file of VLATest; the message names file and key.
    """
    table, entries = vlatest_table(), _read_entries(path)
    ycb = path.name.startswith("ycb_")  # only the file's name tells which catalogue the names are from
    known = table.objects | (table.ycb if ycb else {})
    missing: Counter[str] = Counter()
    scenes: list[Scene] = []
    for key, entry in entries.items():
        task = _task(path, entry)
        if frame == "robot":
            scenes.append(_original_scene(entry, task, ycb=ycb))
            continue
        models = {thing.model for thing in entry.things}
        absent = {model for model in models if model not in known or known[model].name not in catalogue}
        missing.update(absent)
        if not absent:
            placed = [_placement(f"{path}: {key}", entry.things[i], known, task) for i in entry.order]
            targets = tuple(placed[: TASKS[task].targets])
            spoken = [catalogue[target.object].spoken for target in targets]
            instruction = say(load_wordings()[task][0], spoken)
            scenes.append(Scene(task, targets, instruction, confounders=tuple(placed[len(targets) :])))
    return Imported(path, len(entries), tuple(scenes), dict(missing.most_common()))


def _read_entries(path: Path) -> dict[str, _Entry]:
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


def _entry(where: str, raw: object) -> _Entry:
    try:
        if isinstance(raw, dict) and "model_id" in raw:
            grasp = _Grasp.model_validate(raw)
            (taken,) = _things(where, [grasp.model_id], {grasp.model_id: grasp.obj_init_options})
            others = _things(where, grasp.distractor_model_ids, grasp.distractor_obj_init_options)
            return _Entry((taken, *others), (0,))
        two = _Two.model_validate(raw)
    except ValidationError as error:
        raise SceneError(f"{where}: {first_problem(error)}") from None
    things = _things(where, two.model_ids, two.obj_init_options)
    for name, index in (("source_obj_id", two.source_obj_id), ("target_obj_id", two.target_obj_id)):
        if not 0 <= index < len(things):
            raise SceneError(f"{where}: {name}: {index} is not the index of one of {len(things)} objects")
    return _Entry(things, (two.source_obj_id, two.target_obj_id))


def _things(where: str, models: Sequence[str], options: Mapping[str, _Start]) -> tuple[_Thing, ...]:
    for model in models:
        if model not in options:
            raise SceneError(f"{where}: there are no options for {model!r}")
    return tuple(_Thing(model, options[model].init_xy, options[model].quaternion) for model in models)


def _task(path: Path, entry: _Entry) -> str:
    """The task by the targets; if these leave it open, by the file's name."""
    if len(entry.targets) == 1:
        return "pick-up"
    by_receptacle = vlatest_table().places.get(entry.things[entry.targets[1]].model)
    named = next((task for word, task in _FILE_NAMES.items() if word in path.name), None)
    return by_receptacle or (named if named and TASKS[named].targets == 2 else "move-near")


def _placement(where: str, thing: _Thing, known: Mapping[str, Counterpart], task: str) -> Placement:
    """The counterpart of an object; its frame is turned by half a turn, then stretched onto our box."""
    counterpart, table = known[thing.model], vlatest_table()
    w, i, j, z = thing.quaternion
    level = math.hypot(i, j) < 1e-3
    yaw = 2 * math.atan2(z, w)
    half = yaw / 2  # otherwise an object is upright: a quarter turn about x, then the yaw
    upright = [turn * math.sqrt(0.5) for turn in (math.cos(half), math.cos(half), math.sin(half), math.sin(half))]
    if not level and abs(sum(a * b for a, b in zip(thing.quaternion, upright, strict=True))) < 1 - 1e-6:
        problem = f"orientation {thing.quaternion} is neither upright nor level"
        raise SceneError(f"{where}: {thing.model}: {problem}")
    pose = counterpart.poses["level" if level else "turned"]
    turned = math.degrees(yaw) + pose.yaw + 180.0
    wrapped = 180.0 - (180.0 - turned) % 360.0  # in (-180, 180]
    ours, place = load_operators().get(TargetPosition), list[float]()
    for at, (near, far), span in zip(
        thing.xy, (table.frames[task].x, table.frames[task].y), (ours.x, ours.y), strict=True
    ):
        stretch = (span.high - span.low) / (far - near)
        place.append(round((span.low + span.high) / 2 - (at - (near + far) / 2) * stretch, 6))
    x, y = place
    return Placement(counterpart.name, pose.rest, x, y, round(wrapped, 4))


def _original_scene(entry: _Entry, task: str, *, ycb: bool) -> Scene:
    """A scene from the robot's base: every distance and angle to it stays. Receptacles of put tasks are not YCB's."""
    table, original, order = vlatest_table(), vlatest_table().original, entry.order
    robot, in_order = original.robots[task], order == tuple(range(len(order)))
    placed = []
    for index, thing in enumerate(entry.things):
        of_ycb = ycb and thing.model not in table.places
        small = task in original.small_tasks and (of_ycb or thing.model in original.small)
        name = (YCB if of_ycb else CUSTOM) + thing.model
        x, y, quaternion = _from_base(thing, original.bases[task], rig(robot).base)
        scale = original.small_scale if small else 1.0
        placement = Placement(name, "", x, y, quaternion=quaternion, scale=scale)
        placed.append(placement if in_order else replace(placement, listed=index))
    targets, others = order[: len(entry.targets)], order[len(entry.targets) :]
    spoken = [_spoken(entry.things[index].model, original) for index in targets]
    return Scene(
        task,
        tuple(placed[index] for index in targets),
        say(load_wordings()[task][0], spoken),
        confounders=tuple(placed[index] for index in others),
        robot=robot,
    )


def _spoken(model: str, original: Original) -> str:
    """VLATest's name in instructions: ``opened_7up_can`` is "7up can"."""
    words = [word for word in model.split("_") if word not in original.unspoken and not word.endswith("cm")]
    return original.spoken.get(model) or " ".join(words)


def _from_base(thing: _Thing, base: Base, ours: Sequence[float]) -> tuple[float, float, Quaternion]:
    """Position and orientation of an object in the frame of our rig, whose base is at ``ours``."""
    turn = math.radians(-base.yaw)
    x, y = thing.xy[0] - base.x, thing.xy[1] - base.y
    w, i, j, k = thing.quaternion
    cos, sin = math.cos(turn / 2), math.sin(turn / 2)
    quaternion = (cos * w - sin * k, cos * i - sin * j, cos * j + sin * i, cos * k + sin * w)
    level = ours[0] + x * math.cos(turn) - y * math.sin(turn), ours[1] + x * math.sin(turn) + y * math.cos(turn)
    return *level, quaternion
