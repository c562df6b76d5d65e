"""Scenes of VLATest as published: its coordinates, orientations, names, sizes and robots, both ways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from vlafuzz.formats.vlatest.format import Entry, Quaternion, Thing
from vlafuzz.formats.vlatest.table import Base, vlatest_table
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Placement, Scene
from vlafuzz.tasks.instructions import load_wordings, say

# Before a name, as packs put theirs: YCB and the others name things alike.
CUSTOM, YCB = "custom:", "ycb:"
FRAME = "vlatest"  # Scene.frame, of its world


def original_scene(entry: Entry, task: str, *, ycb: bool) -> Scene:
    """A scene in its own frame.

    Args:
        ycb: whether its objects are those of YCB; the places of the put tasks never are.
    """
    placed = [_placement(thing, task, ycb=ycb) for thing in entry.things]
    order = entry.order
    if order != tuple(range(len(order))):
        placed = [replace(placement, listed=place) for place, placement in enumerate(placed)]
    targets, others = order[: len(entry.targets)], order[len(entry.targets) :]
    return Scene(
        task,
        tuple(placed[place] for place in targets),
        original_instruction(task, [entry.things[place].model for place in targets]),
        tuple(placed[place] for place in others),
        robot=vlatest_table().original.robots[task],
        frame=FRAME,
    )


def original_entry(scene: Scene) -> Entry:
    """The inverse; wording, light and camera are not in it."""
    listing = scene.listing
    things = tuple(_thing(placement) for placement in listing)
    return Entry(things, tuple(listing.index(target) for target in scene.targets))


def in_robot_frame(scene: Scene) -> Scene:
    """An original scene as its robot sees it, in the frame of our rig: all distances and angles stay."""
    there, here = _base(scene.task), rig(scene.robot).base
    return _moved(scene, there, Base(x=here[0], y=here[1], yaw=0.0), "")


def as_original(scene: Scene) -> Scene | None:
    """A scene in its own frame, from there or from that of the robot; None for any other scene."""
    if scene.frame == FRAME:
        return scene
    of_theirs = scene.robot == vlatest_table().original.robots.get(scene.task)
    if scene.frame or not of_theirs or not all(placement.quaternion for placement in scene.placements):
        return None
    here = rig(scene.robot).base
    return _moved(scene, Base(x=here[0], y=here[1], yaw=0.0), _base(scene.task), FRAME)


def is_place(name: str) -> bool:
    """Whether things are put on or into an object there."""
    return name.removeprefix(CUSTOM) in vlatest_table().places


def original_instruction(task: str, models: Sequence[str]) -> str:
    """The task's nominal wording with the targets' names as they are spoken there."""
    return say(load_wordings()[task][0], [spoken(model) for model in models])


def original_scale(task: str, name: str) -> float:
    """How large an object is there, of its mesh's size: half of it for most in the put tasks."""
    original = vlatest_table().original
    small = name.startswith(YCB) or bare(name) in original.small
    return original.small_scale if small and task in original.small_tasks else 1.0


def spoken(model: str) -> str:
    """How a name of theirs is spoken there: ``opened_7up_can`` is "7up can"."""
    original = vlatest_table().original
    kept = [word for word in model.split("_") if word not in original.unspoken and not word.endswith("cm")]
    return original.spoken.get(model) or " ".join(kept)


def bare(name: str) -> str:
    """The name of an object of ours there."""
    return name.removeprefix(CUSTOM).removeprefix(YCB)


def _placement(thing: Thing, task: str, *, ycb: bool) -> Placement:
    name = (YCB if ycb and not is_place(thing.model) else CUSTOM) + thing.model
    return Placement(name, "", *thing.xy, quaternion=thing.quaternion, scale=original_scale(task, name))


def _base(task: str) -> Base:
    return vlatest_table().original.bases[task]


def _moved(scene: Scene, old: Base, new: Base, frame: str) -> Scene:
    """The robot from its old base to the new one, and everything with it."""

    def along(placement: Placement) -> Placement:
        turn = math.radians(new.yaw - old.yaw)
        x, y = placement.x - old.x, placement.y - old.y
        return replace(
            placement,
            x=new.x + x * math.cos(turn) - y * math.sin(turn),
            y=new.y + x * math.sin(turn) + y * math.cos(turn),
            quaternion=_turned(placement.quaternion, turn),
        )

    targets, confounders = (tuple(map(along, each)) for each in (scene.targets, scene.confounders))
    return replace(scene, targets=targets, confounders=confounders, frame=frame)


def _turned(quaternion: Quaternion | None, angle: float) -> Quaternion | None:
    """Turned about the vertical by radians; sign and length stay, so that the way back gives the same."""
    if quaternion is None:
        return None
    (w, x, y, z), cos, sin = quaternion, math.cos(angle / 2), math.sin(angle / 2)
    return cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w


def _thing(placement: Placement) -> Thing:
    quaternion = placement.quaternion or (1.0, 0.0, 0.0, 0.0)
    return Thing(bare(placement.object), (placement.x, placement.y), quaternion)
