"""Scene: everything that is shown to the policy, as a value."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import KW_ONLY, asdict, dataclass
from functools import cached_property
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from vlafuzz.errors import SceneError

SCHEMA = 1
# Added after the first digests: left out of the canonical JSON at these values.
_LATER = {"listed": None, "frame": "", "then": ()}
_COUNTS = ("schema", "listed")  # written as whole numbers
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class Placement:
    """One object: its rest pose at (x, y), in metres, turned by ``yaw`` degrees about the vertical.

    For imported scenes: ``quaternion`` (w, x, y, z) replaces rest pose and yaw. It rotates the mesh of a
    pack's object, and (x, y) is then the origin of that mesh. ``scale`` multiplies the object's size.
    ``listed`` is the object's position in a list that does not start with the targets.
    """

    __pydantic_config__ = _STRICT
    object: str
    rest: str
    x: float
    y: float
    yaw: float = 0.0
    _: KW_ONLY
    quaternion: tuple[float, float, float, float] | None = None
    scale: float = 1.0
    listed: int | None = None


@dataclass(frozen=True)
class Light:
    """``intensity`` multiplies all lights of the nominal scene, ambient light included."""

    __pydantic_config__ = _STRICT
    intensity: float = 1.0


@dataclass(frozen=True)
class Camera:
    """The third-person camera's deviation from its nominal pose.

    The camera is ``distance`` metres off, in the direction of ``azimuth`` (about the vertical, from the
    world's x axis) and ``elevation``, and is rotated by ``roll``, ``pitch`` and ``yaw`` about its own axes.
    Angles are in degrees.
    """

    __pydantic_config__ = _STRICT
    distance: float = 0.0
    azimuth: float = 0.0
    elevation: float = 0.0
    _: KW_ONLY
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def offset(self) -> tuple[float, float, float]:
        """Displacement along the world's x, y and z, metres."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = self.distance * math.cos(elevation)
        return level * math.cos(azimuth), level * math.sin(azimuth), self.distance * math.sin(elevation)


@dataclass(frozen=True)
class Scene:
    """Everything that is shown to the policy. Equal scenes have equal digests.

    ``frame`` names the coordinate frame of an imported scene; empty for that of its robot, the only one that
    can be simulated. ``then`` are further instructions: each replaces the one before it when another stage is
    reached.
    """

    __pydantic_config__ = _STRICT
    task: str
    targets: tuple[Placement, ...]
    instruction: str
    _: KW_ONLY
    confounders: tuple[Placement, ...] = ()
    light: Light = Light()
    camera: Camera = Camera()
    robot: str = "panda"
    schema: int = SCHEMA
    frame: str = ""
    then: tuple[str, ...] = ()

    @property
    def instructions(self) -> tuple[str, ...]:
        """All instructions, in order."""
        return (self.instruction, *self.then)

    def instruction_at(self, reached: int) -> str:
        """The instruction after ``reached`` stages."""
        return self.instructions[min(reached, len(self.then))]

    @property
    def placements(self) -> tuple[Placement, ...]:
        """All objects, the targets first."""
        return self.targets + self.confounders

    @property
    def listing(self) -> tuple[Placement, ...]:
        """All objects, in the order in which an imported scene lists them."""
        numbered = [
            (index if placement.listed is None else placement.listed, index)
            for index, placement in enumerate(self.placements)
        ]
        return tuple(self.placements[index] for _, index in sorted(numbered))

    @cached_property
    def digest(self) -> str:
        """32 hexadecimal digits of the canonical JSON."""
        return hashlib.blake2b(self.to_json().encode(), digest_size=16).hexdigest()

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no whitespace, floats as written by ``repr``."""
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
                f"schema: version {scene.schema} of this scene is newer than {SCHEMA}", hint="upgrade vlafuzz"
            )
        return scene


_ADAPTER: TypeAdapter[Scene] = TypeAdapter(Scene)


def _canonical(value: Any) -> Any:
    if isinstance(value, (int, float)):
        return float(value) + 0.0  # 1 equals 1.0, and -0.0 equals 0.0
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
