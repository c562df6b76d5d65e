"""Scenes of VLATest as published: its coordinates, orientations, names, sizes and robots."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.objects.schema import Strict
from vlafuzz.worlds.tabletop.tasks import load_wordings, say
from vlafuzz.worlds.tabletop.vlatest.format import Entry, Thing


class _Pose(Strict):
    rest: str
    yaw: float = 0.0


class _Poses(Strict):
    turned: _Pose
    level: _Pose


class Counterpart(Strict):
    """The object of ours that stands for one of VLATest's."""

    name: str
    poses: _Poses


class Rectangle(Strict):
    """A rectangle on the table in VLATest's coordinates, metres."""

    x: tuple[float, float]
    y: tuple[float, float]


class Base(Strict):
    """The pose of a robot's base: metres, and degrees."""

    x: float
    y: float
    yaw: float


class Original(Strict):
    """What VLATest's files leave out: robots by task, boxes, sizes, and names in instructions."""

    robots: dict[str, str]
    bases: dict[str, Base]
    boxes: dict[str, Rectangle]
    small_tasks: tuple[str, ...]
    small: tuple[str, ...]
    small_scale: float
    unspoken: tuple[str, ...]
    spoken: dict[str, str]


class Table(Strict):
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


# Prefixes of names, as in packs: YCB and VLATest's own catalogue share some names.
CUSTOM, YCB = "custom:", "ycb:"
FRAME = "vlatest"  # Scene.frame: VLATest's world coordinates


def original_scene(entry: Entry, task: str, *, ycb: bool) -> Scene:
    """A scene in VLATest's frame, with objects from YCB or not; receptacles of the put tasks never are."""
    order = entry.order
    placed = []
    for thing in entry.things:
        name = (YCB if ycb and not is_place(thing.model) else CUSTOM) + thing.model
        scale = original_scale(task, name)
        placed.append(Placement(name, "", *thing.xy, quaternion=thing.quaternion, scale=scale))
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
    things = tuple(
        Thing(bare(placed.object), (placed.x, placed.y), placed.quaternion or (1.0, 0.0, 0.0, 0.0))
        for placed in listing
    )
    return Entry(things, tuple(listing.index(target) for target in scene.targets))


def in_robot_frame(scene: Scene) -> Scene:
    """An original scene in the frame of our rig: every distance and angle to the robot stays."""
    return _moved(scene, vlatest_table().original.bases[scene.task], _our_base(scene), "")


def as_original(scene: Scene) -> Scene | None:
    """A scene imported with the frame ``original`` or ``robot``, in VLATest's frame; None for others."""
    if scene.frame == FRAME:
        return scene
    original = vlatest_table().original
    theirs = scene.robot == original.robots.get(scene.task)
    if scene.frame or not theirs or not all(placement.quaternion for placement in scene.placements):
        return None
    return _moved(scene, _our_base(scene), original.bases[scene.task], FRAME)


def _our_base(scene: Scene) -> Base:
    x, y, *_ = rig(scene.robot).base
    return Base(x=x, y=y, yaw=0.0)


def _moved(scene: Scene, old: Base, new: Base, frame: str) -> Scene:
    """Move and turn the scene rigidly, as from the old base of the robot to the new one."""
    turn = math.radians(new.yaw - old.yaw)

    def moved(placement: Placement) -> Placement:
        x, y = placement.x - old.x, placement.y - old.y
        turned = placement.quaternion
        if turned is not None:  # its sign and length stay, so that it can be undone
            (w, i, j, k), cos, sin = turned, math.cos(turn / 2), math.sin(turn / 2)
            turned = cos * w - sin * k, cos * i - sin * j, cos * j + sin * i, cos * k + sin * w
        return replace(
            placement,
            x=new.x + x * math.cos(turn) - y * math.sin(turn),
            y=new.y + x * math.sin(turn) + y * math.cos(turn),
            quaternion=turned,
        )

    targets, confounders = (tuple(map(moved, group)) for group in (scene.targets, scene.confounders))
    return replace(scene, targets=targets, confounders=confounders, frame=frame)


def is_place(name: str) -> bool:
    """Whether an object of VLATest is a receptacle, which others are put on or into."""
    return name.removeprefix(CUSTOM) in vlatest_table().places


def original_scale(task: str, name: str) -> float:
    """The scale of an object's mesh in VLATest: one half for most objects of the put tasks."""
    original = vlatest_table().original
    small = name.startswith(YCB) or bare(name) in original.small
    return original.small_scale if small and task in original.small_tasks else 1.0


def original_instruction(task: str, models: Sequence[str]) -> str:
    """The task's nominal wording with VLATest's names: ``opened_7up_can`` is "7up can"."""
    original, spoken = vlatest_table().original, []
    for model in models:
        words = [word for word in model.split("_") if word not in original.unspoken]
        plain = " ".join(word for word in words if not word.endswith("cm"))
        spoken.append(original.spoken.get(model) or plain)
    return say(load_wordings()[task][0], spoken)


def bare(name: str) -> str:
    """A name without its prefix, as in VLATest's files."""
    return name.removeprefix(CUSTOM).removeprefix(YCB)
