"""Scenes of VLATest as published: its coordinates, orientations, names, sizes and robots."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from pydantic import BaseModel, ConfigDict

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model.scene import Placement, Quaternion, Scene
from vlafuzz.worlds.manipulation.base import Box
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import TargetPosition
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.tabletop.tasks import load_wordings, say
from vlafuzz.worlds.tabletop.vlatest.format import Entry, Thing


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Pose(_Strict):
    rest: str
    yaw: float = 0.0


class _Poses(_Strict):
    turned: _Pose
    level: _Pose


class Counterpart(_Strict):
    """The object of ours that stands for one of VLATest's."""

    name: str
    poses: _Poses


class Rectangle(_Strict):
    """A rectangle on the table in VLATest's coordinates, metres."""

    x: tuple[float, float]
    y: tuple[float, float]


class Base(_Strict):
    """The pose of a robot's base: metres, and degrees."""

    x: float
    y: float
    yaw: float


class Original(_Strict):
    """What VLATest's files leave out: robots by task, boxes, sizes, and names in instructions."""

    robots: dict[str, str]
    bases: dict[str, Base]
    boxes: dict[str, Rectangle]
    small_tasks: tuple[str, ...]
    small: tuple[str, ...]
    small_scale: float
    unspoken: tuple[str, ...]
    spoken: dict[str, str]


class Table(_Strict):
    """The content of operators/objects/vlatest.yaml."""

    frames: dict[str, Rectangle]
    places: dict[str, str]
    objects: dict[str, Counterpart]
    ycb: dict[str, Counterpart]
    original: Original

    def drawn_from(self, task: str) -> Rectangle:
        """The box that VLATest samples positions from: by default the frame."""
        return self.original.boxes.get(task, self.frames[task])


@cache
def vlatest_table() -> Table:
    """The table, read once."""
    path = operators_dir() / "objects" / "vlatest.yaml"
    return validated(Table, read_yaml(path, CatalogueError), path, CatalogueError)


@cache
def our_box() -> Box:
    """The range of our targets' positions."""
    position = load_operators().get(TargetPosition)
    return Box(x=position.x, y=position.y)


# Prefixes of names, as in packs: YCB and VLATest's own catalogue share some names.
CUSTOM, YCB = "custom:", "ycb:"
FRAME = "vlatest"  # Scene.frame: VLATest's world coordinates


def original_scene(entry: Entry, task: str, *, ycb: bool) -> Scene:
    """A scene in VLATest's frame.

    Args:
        ycb: whether its objects are from YCB; the receptacles of the put tasks never are.
    """
    placed = [_placement(thing, task, ycb=ycb) for thing in entry.things]
    order = entry.order
    if order != tuple(range(len(order))):
        placed = [replace(placement, listed=index) for index, placement in enumerate(placed)]
    targets, others = order[: len(entry.targets)], order[len(entry.targets) :]
    return Scene(
        task,
        tuple(placed[index] for index in targets),
        original_instruction(task, [entry.things[index].model for index in targets]),
        confounders=tuple(placed[index] for index in others),
        robot=vlatest_table().original.robots[task],
        frame=FRAME,
    )


def original_entry(scene: Scene) -> Entry:
    """The inverse of ``original_scene``; wording, light and camera are lost."""
    listing = scene.listing
    things = tuple(_thing(placement) for placement in listing)
    return Entry(things, tuple(listing.index(target) for target in scene.targets))


def in_robot_frame(scene: Scene) -> Scene:
    """An original scene in the frame of our rig: every distance and angle to the robot stays."""
    there, here = vlatest_table().original.bases[scene.task], rig(scene.robot).base
    return _moved(scene, there, Base(x=here[0], y=here[1], yaw=0.0), "")


def as_original(scene: Scene) -> Scene | None:
    """A scene imported with the frame ``original`` or ``robot``, in VLATest's frame; None for others."""
    if scene.frame == FRAME:
        return scene
    vlatest_robot = scene.robot == vlatest_table().original.robots.get(scene.task)
    if scene.frame or not vlatest_robot or not all(placement.quaternion for placement in scene.placements):
        return None
    here = rig(scene.robot).base
    there = vlatest_table().original.bases[scene.task]
    return _moved(scene, Base(x=here[0], y=here[1], yaw=0.0), there, FRAME)


def is_place(name: str) -> bool:
    """Whether an object of VLATest is a receptacle, which others are put on or into."""
    return name.removeprefix(CUSTOM) in vlatest_table().places


def original_instruction(task: str, models: Sequence[str]) -> str:
    """The task's nominal wording with the names that VLATest's instructions use."""
    return say(load_wordings()[task][0], [spoken(model) for model in models])


def original_scale(task: str, name: str) -> float:
    """The scale of an object's mesh in VLATest: one half for most objects of the put tasks."""
    original = vlatest_table().original
    small = name.startswith(YCB) or bare(name) in original.small
    return original.small_scale if small and task in original.small_tasks else 1.0


def spoken(model: str) -> str:
    """A model's name in VLATest's instructions: ``opened_7up_can`` is "7up can"."""
    original = vlatest_table().original
    kept = [word for word in model.split("_") if word not in original.unspoken and not word.endswith("cm")]
    return original.spoken.get(model) or " ".join(kept)


def bare(name: str) -> str:
    """A name without its prefix, as in VLATest's files."""
    return name.removeprefix(CUSTOM).removeprefix(YCB)


def _placement(thing: Thing, task: str, *, ycb: bool) -> Placement:
    name = (YCB if ycb and not is_place(thing.model) else CUSTOM) + thing.model
    return Placement(name, "", *thing.xy, quaternion=thing.quaternion, scale=original_scale(task, name))


def _moved(scene: Scene, old: Base, new: Base, frame: str) -> Scene:
    """Move and turn the scene rigidly, as from the old base of the robot to the new one."""

    def moved(placement: Placement) -> Placement:
        turn = math.radians(new.yaw - old.yaw)
        x, y = placement.x - old.x, placement.y - old.y
        return replace(
            placement,
            x=new.x + x * math.cos(turn) - y * math.sin(turn),
            y=new.y + x * math.sin(turn) + y * math.cos(turn),
            quaternion=_turned(placement.quaternion, turn),
        )

    targets, confounders = (tuple(map(moved, group)) for group in (scene.targets, scene.confounders))
    return replace(scene, targets=targets, confounders=confounders, frame=frame)


def _turned(quaternion: Quaternion | None, angle: float) -> Quaternion | None:
    """Turned about the vertical by ``angle`` radians; keeps sign and length, so that it can be undone."""
    if quaternion is None:
        return None
    (w, x, y, z), cos, sin = quaternion, math.cos(angle / 2), math.sin(angle / 2)
    return cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w


def _thing(placement: Placement) -> Thing:
    quaternion = placement.quaternion or (1.0, 0.0, 0.0, 0.0)
    return Thing(bare(placement.object), (placement.x, placement.y), quaternion)
