"""Scene: everything that is shown to the policy, as a value."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from vlafuzz.errors import SceneError

SCHEMA = 1
# Digests are older than these: with this value they are not there.
_LATER = {"listed": None, "frame": "", "then": ()}
_COUNTS = ("schema", "listed")  # written as whole numbers
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class Placement:
    """One object: its rest pose at (x, y), in metres, turned by ``yaw`` degrees about the vertical.

    For imported scenes: ``quaternion`` (w, x, y, z) replaces rest pose and yaw. It is of the mesh that a
    pack's object is made of, and (x, y) is where then that mesh's origin is. ``scale`` is of the object's
    size, and ``listed`` its place among all objects where they are not listed with the targets first.
    """

    __pydantic_config__ = _STRICT
    object: str
    rest: str
    x: float
    y: float
    yaw: float = 0.0
    quaternion: tuple[float, float, float, float] | None = None
    scale: float = 1.0
    listed: int | None = None


@dataclass(frozen=True)
class Light:
    """``intensity`` multiplies every light of the nominal scene, the ambient one included."""

    __pydantic_config__ = _STRICT
    intensity: float = 1.0


@dataclass(frozen=True)
class Camera:
    """The third-person camera's deviation from its nominal pose.

    It stands ``distance`` metres off, in the direction of ``azimuth`` (about the vertical, from the
    world's x axis) and
    ``elevation``, and is turned by ``roll``, ``pitch`` and ``yaw`` about its own axes. All angles in degrees.
    """

    __pydantic_config__ = _STRICT
    distance: float = 0.0
    azimuth: float = 0.0
    elevation: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def offset(self) -> tuple[float, float, float]:
        """Metres along the world's x, y and z."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = self.distance * math.cos(elevation)
        return level * math.cos(azimuth), level * math.sin(azimuth), self.distance * math.sin(elevation)


@dataclass(frozen=True)
class Scene:
    """Everything that is shown to the policy. Equal scenes are equal, and have equal digests.

    ``frame`` names the world that an imported scene's coordinates are of; none for that of its robot, the
    only one that can be run. ``then`` are instructions that take the first one's place, one after the other:
    each once another stage is reached.
    """

    __pydantic_config__ = _STRICT
    task: str
    targets: tuple[Placement, ...]
    instruction: str
    confounders: tuple[Placement, ...] = ()
    light: Light = Light()
    camera: Camera = Camera()
    robot: str = "panda"
    schema: int = SCHEMA
    frame: str = ""
    then: tuple[str, ...] = ()

    @property
    def instructions(self) -> tuple[str, ...]:
        """All of them, in their order."""
        return (self.instruction, *self.then)

    def said(self, reached: int) -> str:
        """The instruction once so many stages are reached."""
        return self.instructions[min(reached, len(self.then))]

    @property
    def placements(self) -> tuple[Placement, ...]:
        """All objects, the targets first."""
        return self.targets + self.confounders

    @property
    def listing(self) -> tuple[Placement, ...]:
        """All objects, in the order in which an imported scene lists them."""
        places = [place if each.listed is None else each.listed for place, each in enumerate(self.placements)]
        return tuple(self.placements[place] for place in sorted(range(len(places)), key=places.__getitem__))

    @cached_property
    def digest(self) -> str:
        """32 hexadecimal digits of the canonical JSON."""
        return hashlib.blake2b(self.to_json().encode(), digest_size=16).hexdigest()

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no blanks, floats as written by ``repr``."""
        return json.dumps(_canonical(asdict(self)), sort_keys=True, separators=(",", ":"))

    @staticmethod
    def from_json(text: str | bytes) -> Scene:
        """Read one scene.

        Raises:
            SceneError: not JSON, or not a scene; the message names the key.
        """
        try:
            scene = _ADAPTER.validate_json(text)
        except ValidationError as error:
            raise SceneError(
                _first_problem(error), hint="`vlafuzz run` and `vlafuzz import` write valid scenes"
            ) from None
        if scene.schema > SCHEMA:
            raise SceneError(
                f"schema: this scene has version {scene.schema}, newer than {SCHEMA}", hint="upgrade vlafuzz"
            )
        return scene


_ADAPTER: TypeAdapter[Scene] = TypeAdapter(Scene)


def _canonical(value: Any) -> Any:
    if isinstance(value, (int, float)):
        return float(value) + 0.0  # 1 and 1.0 are one value, and so are -0.0 and 0.0
    if isinstance(value, dict):
        kept = {key: item for key, item in value.items() if key not in _LATER or item != _LATER[key]}
        return {key: item if key in _COUNTS else _canonical(item) for key, item in kept.items()}
    if isinstance(value, (list, tuple)):
        return [_canonical(item) for item in value]
    return value


def _first_problem(error: ValidationError) -> str:
    problem = error.errors()[0]
    where = ".".join(str(part) for part in problem["loc"])
    shown = repr(problem["input"])
    shown = shown if len(shown) <= 60 else shown[:57] + "..."
    return f"{where + ': ' if where else ''}{problem['msg'].lower()}, got {shown}"
