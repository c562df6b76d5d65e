"""The schema of object catalogues in YAML. Metres, kilograms, sRGB colours in [0, 1]."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from vlafuzz.common.reading import read_yaml
from vlafuzz.common.text import shortened
from vlafuzz.errors import CatalogueError, suggestion

Length = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Unit = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Direction = Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[a-z0-9_]+$", max_length=100)]  # a folder has it, too
Colour = tuple[Unit, Unit, Unit]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Fitting(Strict):
    """A shape whose lengths restrict each other."""

    def fits(self) -> bool:
        return True

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.fits():
            raise ValueError(f"these lengths do not fit together, got {self.model_dump(exclude={'kind'})}")
        return self


class Can(Fitting):
    """A drink can, axis z. ``neck`` is the radius of both ends, ``shoulder`` the height of the tapers."""

    kind: Literal["can"]
    radius: Length
    height: Length
    neck: Length
    shoulder: Length

    def fits(self) -> bool:
        return self.neck <= self.radius and 2 * self.shoulder < self.height


class Bottle(Fitting):
    """A bottle, axis z: a body, a tapering shoulder, a cylindrical neck with its cap."""

    kind: Literal["bottle"]
    radius: Length
    height: Length
    neck: Length
    neck_height: Length
    shoulder: Length

    def fits(self) -> bool:
        return self.neck < self.radius and self.neck_height + self.shoulder < self.height


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


class Egg(Fitting):
    """The hull of two balls on the x axis, the thick one at +x."""

    kind: Literal["egg"]
    length: Length
    radius: Length
    tip: Length

    def fits(self) -> bool:
        return self.tip <= self.radius < self.length / 2


class Spoon(Fitting):
    """A spoon along x, bowl at -x; the handle arches up to ``height`` and touches the table at its end."""

    kind: Literal["spoon"]
    length: Length
    width: Length
    height: Length
    bowl: Length
    depth: Length
    handle: Length
    thickness: Length

    def fits(self) -> bool:
        return self.bowl < self.length and self.thickness < self.depth < self.height


class Plate(Fitting):
    """A round disc of thickness ``floor`` with a rim, ``rim`` wide, that rises to ``height``."""

    kind: Literal["plate"]
    diameter: Length
    height: Length
    floor: Length
    rim: Length

    def fits(self) -> bool:
        return self.floor < self.height and self.rim < self.diameter / 2


class Basket(Strict):
    """An open box. ``inner``: width (x), depth (y) and height (z) of the cavity."""

    kind: Literal["basket"]
    inner: tuple[Length, Length, Length]
    wall: Length


Shape = Annotated[
    Can | Bottle | Ball | Box | Carrot | Egg | Spoon | Plate | Basket, Field(discriminator="kind")
]
KINDS: dict[int | str, type[BaseModel]] = {
    get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in get_args(get_args(Shape)[0])
}
FLAT_PATTERNS = ("plain", "pores", "checks", "stripes")
ROUND_PATTERNS = ("plain", "label", "fruit", "peel", "weave", "rim", "rings", "calyx")


class Look(Strict):
    """The pattern painted over the object's base colour. ``motif`` decorates a label."""

    pattern: Literal[
        "label", "plain", "fruit", "peel", "pores", "checks", "stripes", "weave", "rim", "rings", "calyx"
    ]
    accent: Colour = (1.0, 1.0, 1.0)
    ink: Colour = (1.0, 1.0, 1.0)
    word: str = ""
    motif: Literal["none", "wave", "ribbon", "disc", "bubbles", "splash", "checks"] = "none"
    roughness: Unit = 0.6


class StablePoseSpec(Strict):
    """Selects the stable face of the object's hull for which ``up`` points most nearly upwards."""

    up: tuple[Direction, Direction, Direction]
    rolls: bool = False

    @field_validator("up")
    @classmethod
    def _points_somewhere(cls, up: tuple[float, float, float]) -> tuple[float, float, float]:
        if not any(up):
            raise ValueError("must not be zero")
        return up


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

    @field_validator("look")
    @classmethod
    def _suits_the_shape(cls, look: Look, info: ValidationInfo) -> Look:
        shape = info.data.get("shape")  # missing if it failed validation itself
        known = FLAT_PATTERNS if isinstance(shape, Box) else ROUND_PATTERNS
        if shape is not None and look.pattern not in known:
            raise ValueError(f"a {shape.kind} can be painted {', '.join(known)} only, got {look.pattern!r}")
        return look


class CatalogueFile(Strict):
    objects: Annotated[dict[Name, ObjectSpec], Field(min_length=1)]


def read_file(path: Path) -> dict[str, ObjectSpec]:
    """Read one catalogue file.

    Raises:
        CatalogueError: naming the file, the key and the value.
    """
    raw = read_yaml(path, CatalogueError)
    try:
        return CatalogueFile.model_validate(raw).objects
    except ValidationError as error:
        raise _explain(path, raw, error) from None


def _explain(path: Path, raw: Any, error: ValidationError) -> CatalogueError:
    """Turn pydantic's first error into one sentence with file, key path and value."""
    first = error.errors(include_url=False)[0]
    keys = _keys(raw, first["loc"])
    where = f"{path}: {'.'.join(keys)}" if keys else str(path)
    match first["type"]:
        case "missing":
            return CatalogueError(f"{where}: missing")
        case "extra_forbidden":
            return CatalogueError(f"{where}: unknown key", suggestion(keys[-1], _known_keys(first["loc"])))
        case "literal_error" | "union_tag_invalid":
            context = first["ctx"]
            known = re.findall(r"'([^']+)'", str(context.get("expected") or context["expected_tags"]))
            value = context.get("tag", first["input"])
            return CatalogueError(f"{where}: unknown value {shortened(value)}", suggestion(str(value), known))
    if first["type"] == "value_error":
        return CatalogueError(f"{where}: {first['ctx']['error']}")
    return CatalogueError(
        f"{where}: {first['msg'][0].lower()}{first['msg'][1:]}, got {shortened(first['input'])}"
    )


def _keys(raw: Any, location: tuple[int | str, ...]) -> list[str]:
    """An error's location as the user wrote it, without the shape's kind that pydantic inserts."""
    keys: list[str] = []
    for step in location:
        if step in KINDS and keys[-1:] == ["shape"] and step not in (raw if isinstance(raw, dict) else ()):
            continue
        keys.append(str(step))
        if isinstance(raw, dict):
            raw = raw.get(step)
    return keys


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    """The keys allowed at the location of an unknown key."""
    parents = [step for step in location[:-1] if isinstance(step, str)]
    inside: dict[str, type[BaseModel]] = {"look": Look, "rests": StablePoseSpec}
    model: type[BaseModel] = ObjectSpec if parents else CatalogueFile
    if len(parents) > 2:
        model = KINDS.get(parents[-1]) or inside[parents[2]]
    return list(model.model_fields)
