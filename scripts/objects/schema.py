"""The schema of object catalogues in YAML. Metres, kilograms, sRGB colours in [0, 1]."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError

Length = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Unit = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Direction = Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[a-z0-9_]+$", max_length=100)]  # a folder has it, too
Colour = tuple[Unit, Unit, Unit]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Can(Strict):
    """A drink can, axis z. ``neck`` is the radius of both ends, ``shoulder`` the height of the tapers."""

    kind: Literal["can"]
    radius: Length
    height: Length
    neck: Length
    shoulder: Length


class Bottle(Strict):
    """A bottle, axis z: a body, a tapering shoulder, a cylindrical neck with its cap."""

    kind: Literal["bottle"]
    radius: Length
    height: Length
    neck: Length
    neck_height: Length
    shoulder: Length


class Ball(Strict):
    """A ball, squashed along z, with a flat base. ``dimple``: depth at the stalk, visual only."""

    kind: Literal["ball"]
    diameter: Length
    height: Length
    dimple: Annotated[float, Field(ge=0, le=0.02)] = 0.0


class Box(Strict):
    kind: Literal["box"]
    size: tuple[Length, Length, Length]


class Carrot(Strict):
    """A truncated cone, axis x, thick end at -x."""

    kind: Literal["carrot"]
    length: Length
    radius: Length
    tip: Length


class Egg(Strict):
    """The hull of two balls on the x axis, the thick one at +x."""

    kind: Literal["egg"]
    length: Length
    radius: Length
    tip: Length


class Spoon(Strict):
    """A spoon along x, bowl at -x; the handle arches up to ``height`` and touches the table at its end."""

    kind: Literal["spoon"]
    length: Length
    width: Length
    height: Length
    bowl: Length
    depth: Length
    handle: Length
    thickness: Length


class Plate(Strict):
    """A round disc of thickness ``floor`` with a rim, ``rim`` wide, that rises to ``height``."""

    kind: Literal["plate"]
    diameter: Length
    height: Length
    floor: Length
    rim: Length


class Basket(Strict):
    """An open box. ``inner``: width (x), depth (y) and height (z) of the cavity."""

    kind: Literal["basket"]
    inner: tuple[Length, Length, Length]
    wall: Length


Shape = Annotated[Can | Bottle | Ball | Box | Carrot | Egg | Spoon | Plate | Basket, Field(discriminator="kind")]


class Look(Strict):
    """The pattern painted over the object's base colour. ``motif`` decorates a label."""

    pattern: Literal["label", "plain", "fruit", "peel", "pores", "checks", "stripes", "weave", "rim", "rings", "calyx"]
    accent: Colour = (1.0, 1.0, 1.0)
    ink: Colour = (1.0, 1.0, 1.0)
    word: str = ""
    motif: Literal["none", "wave", "ribbon", "disc", "bubbles", "splash", "checks"] = "none"
    roughness: Unit = 0.6


class StablePoseSpec(Strict):
    """Selects the stable face of the object's hull for which ``up``, not zero, points most nearly upwards."""

    up: tuple[Direction, Direction, Direction]
    rolls: bool = False


class ObjectSpec(Strict):
    """One object. ``spoken`` defaults to the name with spaces; ``friction`` is static and dynamic."""

    spoken: str = ""
    role: Literal["graspable", "place"]
    mass: Annotated[float, Field(gt=0, le=20, allow_inf_nan=False)]
    colour: Colour
    shape: Shape
    look: Look
    rests: Annotated[dict[str, StablePoseSpec], Field(min_length=1)]
    friction: Annotated[float, Field(ge=0, le=5)] = 0.6
    supports: bool = False


class CatalogueFile(Strict):
    objects: Annotated[dict[Name, ObjectSpec], Field(min_length=1)]


def read_file(path: Path) -> dict[str, ObjectSpec]:
    """The objects of a catalogue file; a CatalogueError names the file, the key and the value."""
    return validated(CatalogueFile, read_yaml(path, CatalogueError), path, CatalogueError).objects
