"""VLATest's names, poses, boxes and robots, and our counterparts: operators/objects/vlatest.yaml."""

from functools import cache

from pydantic import BaseModel, ConfigDict

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.manipulation.base import Box
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import TargetPosition


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
