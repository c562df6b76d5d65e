"""What is what in scenes of VLATest: names, poses, boxes, robots. See operators/objects/vlatest.yaml."""

from __future__ import annotations

from functools import cache

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from vlafuzz.errors import CatalogueError
from vlafuzz.shipped import operators_dir
from vlafuzz.space.operator_set import load_operators
from vlafuzz.space.operators import TargetPosition
from vlafuzz.space.ranges import Box


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


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


class Rectangle(_Strict):
    """A rectangle of the table in its coordinates, metres."""

    x: tuple[float, float]
    y: tuple[float, float]


class Base(_Strict):
    """Where a robot stands, metres, and where it faces, degrees."""

    x: float
    y: float
    yaw: float


class Original(_Strict):
    """What its files leave unsaid: robots by task, boxes, sizes, and how its names are spoken."""

    robots: dict[str, str]
    bases: dict[str, Base]
    boxes: dict[str, Rectangle]
    small_tasks: tuple[str, ...]
    small: tuple[str, ...]
    small_scale: float
    unspoken: tuple[str, ...]
    spoken: dict[str, str]


class Table(_Strict):
    """operators/objects/vlatest.yaml."""

    frames: dict[str, Rectangle]
    places: dict[str, str]
    objects: dict[str, Counterpart]
    ycb: dict[str, Counterpart]
    original: Original

    def drawn_from(self, task: str) -> Rectangle:
        """Where its objects are drawn from: the frame, where nothing else is said."""
        return self.original.boxes.get(task, self.frames[task])


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
