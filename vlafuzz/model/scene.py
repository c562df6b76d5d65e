"""Scene: everything that is shown to the policy, as a value."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, MISSING, dataclass, field, fields, is_dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, cast

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)

from vlafuzz.common.reading import first_problem, plain
from vlafuzz.errors import SceneError

SCHEMA = 1
MOST = 100  # objects or values
# Of scenes from outside: far beyond what is fair, and near enough that squares and differences stay numbers.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
Quaternion = tuple[Real, Real, Real, Real]  # w, x, y, z
Text = Annotated[str, Field(max_length=10_000), AfterValidator(plain)]


def _quantity(unit: str, default: Any = MISSING) -> Any:
    return field(default=default, metadata={"unit": unit})


def _later(default: Any) -> Any:
    """A field younger than the first digests: at its default, the canonical JSON leaves it out."""
    return field(default=default, metadata={"later": True})


_EXTRA = {"later": True, "extra": True}  # the part of a scene that an extra operator varies


class _Strict:
    """Refuses unknown keys and numbers that are not finite when it is read."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class Placement(_Strict):
    """One object: its rest pose at (x, y), in metres, turned by ``yaw`` degrees about the vertical.

    For imported scenes: ``quaternion`` (w, x, y, z) replaces rest pose and yaw. It rotates the mesh of a pack's object,
    and (x, y) is then the origin of that mesh. ``scale`` multiplies the object's size. ``listed`` is the object's
    position in a list that does not start with the targets.
    """

    object: Text
    rest: Text
    x: Real = _quantity(" m")
    y: Real = _quantity(" m")
    yaw: Real = _quantity("°", 0.0)
    _: KW_ONLY
    quaternion: Quaternion | None = None
    scale: Real = 1.0
    listed: Annotated[int, Field(strict=True, ge=0, le=10**6)] | None = _later(None)


@dataclass(frozen=True)
class Light(_Strict):
    """``intensity`` multiplies all lights of the nominal scene, ambient light included."""

    intensity: Real = _quantity("×", 1.0)


@dataclass(frozen=True)
class Camera(_Strict):
    """The third-person camera's deviation from its nominal pose.

    The camera is ``distance`` metres off, in the direction of ``azimuth`` (about the vertical, from the world's x axis)
    and ``elevation``, and is rotated by ``roll``, ``pitch`` and ``yaw`` about its own axes. Angles are in degrees.
    """

    distance: Real = _quantity(" m", 0.0)
    azimuth: Real = _quantity("°", 0.0)
    elevation: Real = _quantity("°", 0.0)
    _: KW_ONLY
    roll: Real = _quantity("°", 0.0)
    pitch: Real = _quantity("°", 0.0)
    yaw: Real = _quantity("°", 0.0)

    @property
    def offset(self) -> tuple[float, float, float]:
        """Displacement along the world's x, y and z, metres."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = self.distance * math.cos(elevation)
        return level * math.cos(azimuth), level * math.sin(azimuth), self.distance * math.sin(elevation)


Pattern = Literal["planks", "plain", "checker", "speckle", "stripes"]
TablePaint = Literal["oak", "white", "grey", "black", "red", "green", "blue"]
WallPaint = Literal["sage", "white", "grey", "black", "red", "green", "blue"]


@dataclass(frozen=True)
class Backdrop(_Strict):
    """Pattern and colour of the table top, and the colour of the wall behind the robot."""

    table: Pattern = "planks"
    colour: TablePaint = "oak"
    wall: WallPaint = "sage"


@dataclass(frozen=True, kw_only=True)
class InitialPose(_Strict):
    """Offsets of the arm's joints at the start of an episode, from the base on; degrees."""

    j1: Real = _quantity("°", 0.0)
    j2: Real = _quantity("°", 0.0)
    j3: Real = _quantity("°", 0.0)
    j4: Real = _quantity("°", 0.0)
    j5: Real = _quantity("°", 0.0)
    j6: Real = _quantity("°", 0.0)
    j7: Real = _quantity("°", 0.0)


@dataclass(frozen=True)
class Noise(_Strict):
    """Noise in every image that the policy sees, applied in this order.

    ``blur`` and ``grain`` are standard deviations of Gaussian blur and Gaussian noise. ``jpeg`` is the quality of JPEG
    compression, 100 for none.
    """

    blur: Annotated[Real, Field(ge=0, le=100)] = _quantity(" px", 0.0)
    grain: Annotated[Real, Field(ge=0)] = _quantity(" grey levels", 0.0)
    jpeg: Annotated[Real, Field(ge=1, le=100)] = 100.0


@dataclass(frozen=True)
class Latency(_Strict):
    """``delay`` in control steps, from the policy's answer to its execution."""

    delay: Annotated[int, Field(strict=True, ge=0, le=100)] = _quantity(" steps", 0)


@dataclass(frozen=True)
class Exposure(_Strict):
    """``auto``: how far the cameras' exposure follows the light, from 0, fixed, to 1."""

    auto: Annotated[Real, Field(ge=0, le=1)] = 0.0


@dataclass(frozen=True)
class Start(_Strict):
    """``state``: number of the initial state from which a scene deviates, where a task has several."""

    state: Annotated[int, Field(strict=True, ge=0, le=10**6)] = 0


Moment = Literal["start", "approach", "grasp", "carry"]


@dataclass(frozen=True)
class Event(_Strict):
    """Something that happens once in the middle of an episode, at the moment ``when``; see ``worlds.events``."""

    when: Moment = "approach"


@dataclass(frozen=True)
class Slide(Event):
    """A target is slid over the table: how far, and in which direction about the vertical, from the world's x axis."""

    distance: Annotated[Real, Field(ge=0)] = _quantity(" m", 0.0)
    direction: Real = _quantity("°", 0.0)


@dataclass(frozen=True)
class CameraBump(Event):
    """The third-person camera is turned about its own axes, and stays so."""

    roll: Real = _quantity("°", 0.0)
    pitch: Real = _quantity("°", 0.0)
    yaw: Real = _quantity("°", 0.0)


@dataclass(frozen=True)
class LightSwitch(Event):
    """All lights are multiplied by ``intensity``, and stay so."""

    intensity: Annotated[Real, Field(gt=0)] = _quantity("×", 1.0)


@dataclass(frozen=True)
class PictureLoss(Event):
    """For some control steps the policy sees the last picture again, or a black one."""

    duration: Annotated[int, Field(strict=True, ge=0, le=1000)] = _quantity(" steps", 0)
    shows: Literal["frozen", "black"] = "frozen"


@dataclass(frozen=True)
class ControlStall(Event):
    """The robot stands still for some control steps; what the policy commands meanwhile is lost."""

    duration: Annotated[int, Field(strict=True, ge=0, le=1000)] = _quantity(" steps", 0)


@dataclass(frozen=True)
class GripSlip(Event):
    """The fingers open for some control steps, whatever the policy commands."""

    when: Moment = "carry"
    duration: Annotated[int, Field(strict=True, ge=0, le=1000)] = _quantity(" steps", 0)


@dataclass(frozen=True)
class TargetTopple(Event):
    """The first target falls onto its side: into the rest pose of that name."""

    rest: Literal["same", "lying"] = "same"


@dataclass(frozen=True)
class GripWeak(Event):
    """The fingers press with ``force`` times their usual force, and go on so."""

    force: Annotated[Real, Field(gt=0)] = _quantity("×", 1.0)


@dataclass(frozen=True)
class InstructionChange(Event):
    """The instruction names another thing than the first target from then on, a confounder; or it is ``STOP``."""

    to: Literal["same", "first", "second", "third", "stop"] = "same"


@dataclass(frozen=True)
class Newcomer(Event):
    """One of the confounders is not there before: it is put down where it belongs, as soon as there is room."""

    thing: Literal["none", "first", "second", "third"] = "none"


@dataclass(frozen=True)
class Scene(_Strict):
    """Everything that is shown to the policy. Equal scenes have equal digests.

    ``values`` are those of a world without a table, by name, in place of targets.
    """

    task: Text
    targets: Annotated[tuple[Placement, ...], Field(max_length=MOST)]
    instruction: Text
    _: KW_ONLY
    confounders: Annotated[tuple[Placement, ...], Field(max_length=MOST)] = ()
    light: Light = Light()
    camera: Camera = Camera()
    robot: Text = "panda"
    schema: Annotated[int, Field(strict=True, ge=0, le=10**6)] = SCHEMA
    backdrop: Backdrop = field(default=Backdrop(), metadata=_EXTRA)
    initial_pose: InitialPose = field(default=InitialPose(), metadata=_EXTRA)
    noise: Noise = field(default=Noise(), metadata=_EXTRA)
    latency: Latency = field(default=Latency(), metadata=_EXTRA)
    start: Start = field(default=Start(), metadata=_EXTRA)
    target_slide: Slide = field(default=Slide(), metadata=_EXTRA)
    goal_slide: Slide = field(default=Slide(), metadata=_EXTRA)
    camera_bump: CameraBump = field(default=CameraBump(), metadata=_EXTRA)
    light_switch: LightSwitch = field(default=LightSwitch(), metadata=_EXTRA)
    picture_loss: PictureLoss = field(default=PictureLoss(), metadata=_EXTRA)
    control_stall: ControlStall = field(default=ControlStall(), metadata=_EXTRA)
    grip_slip: GripSlip = field(default=GripSlip(), metadata=_EXTRA)
    target_topple: TargetTopple = field(default=TargetTopple(), metadata=_EXTRA)
    grip_weak: GripWeak = field(default=GripWeak(), metadata=_EXTRA)
    instruction_change: InstructionChange = field(default=InstructionChange(), metadata=_EXTRA)
    newcomer: Newcomer = field(default=Newcomer(), metadata=_EXTRA)
    target_knock: TargetTopple = field(default=TargetTopple(), metadata=_EXTRA)
    target_switch: InstructionChange = field(default=InstructionChange(), metadata=_EXTRA)  # among a state's own things
    exposure: Exposure = field(default=Exposure(), metadata=_EXTRA)
    values: Annotated[tuple[tuple[Text, Real | Text], ...], Field(max_length=MOST)] = _later(())

    @property
    def placements(self) -> tuple[Placement, ...]:
        """All objects, the targets first."""
        return self.targets + self.confounders

    @cached_property
    def events(self) -> Mapping[str, Event]:
        """Returns what happens in the middle of an episode, by the name of the scene's field."""
        return {name: getattr(self, name) for name, usual in EVENTS.items() if getattr(self, name) != usual}

    @cached_property
    def digest(self) -> str:
        """32 hexadecimal digits of the canonical JSON."""
        return hashlib.blake2b(self._json.encode(), digest_size=16).hexdigest()

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no whitespace, floats as written by ``repr``."""
        return self._json

    @cached_property
    def _json(self) -> str:
        return json.dumps(_canonical(self), sort_keys=True, separators=(",", ":"))

    @staticmethod
    def from_json(text: str | bytes) -> Scene:
        """Read one scene; a SceneError names the key where that is none."""
        try:
            scene = _ADAPTER.validate_json(text)
        except ValidationError as error:
            hint = "`vlafuzz run` and `vlafuzz export` write valid scenes"
            raise SceneError(first_problem(error), hint) from None
        if bool(scene.targets) is bool(scene.values):
            hint = "a scene on a table has targets, one of another world values by name"
            raise SceneError("targets: expected at least one, or values in their place", hint)
        if scene.schema > SCHEMA:
            problem = f"schema: version {scene.schema} of this scene is newer than {SCHEMA}"
            raise SceneError(problem, hint="upgrade vlafuzz")
        return scene


_ADAPTER: TypeAdapter[Scene] = TypeAdapter(Scene)
EXTRAS: dict[str, Any] = {part.name: part.default for part in fields(Scene) if part.metadata.get("extra")}
"""The parts of a scene that extra operators vary, by field name, with their nominal values."""
EVENTS: dict[str, Any] = {name: part for name, part in EXTRAS.items() if isinstance(part, Event)}
"""Those of them that happen in the middle of an episode."""
UNITS: dict[str, str] = {
    part.name: part.metadata["unit"]
    for kind in (Placement, Light, Camera, *map(type, EXTRAS.values()))
    for part in fields(kind)
    if "unit" in part.metadata
}
"""What is written behind a number, by field name; worlds of values add theirs by the path of the value."""


def _kept(value: object, info: ValidationInfo) -> Scene:
    return value if isinstance(value, Scene) else cast(Scene, cast(Any, info.context)(value))


Kept = Annotated[Scene, PlainValidator(_kept), PlainSerializer(lambda scene: scene.digest)]
"""A scene that is kept elsewhere: pydantic writes its digest, and reads it by a context, a function of the digest."""


def in_words(path: str, value: float | str, operator: str = "") -> str:
    """A value by its path: ``yaw 2.5°``; beside its operator, which is not said again, ``x 5 cm`` for ``goal-x``."""
    slot, _, name = path.rpartition(".")
    owner = f" of object {int(slot[-1]) + 1}" if slot.startswith("targets.") and slot[-1] != "0" else ""
    short = "" if name == operator else name.removeprefix(f"{operator}-")
    return f"{short}{owner} {amount(path, value)}".strip()


def amount(path: str, value: float | str) -> str:
    """A value without its name: ``2.5°``."""
    if isinstance(value, str):
        return value
    unit = unit_of(path)
    return f"× {value:.3g}" if unit == "×" else f"{value:g}{unit.removesuffix('s') if value == 1 else unit}"


def unit_of(path: str) -> str:
    """What stands behind a value, or ``×`` before it; empty for a bare number."""
    return UNITS.get(path if path.startswith("values.") else path.rpartition(".")[2], "")


def _canonical(value: Any) -> Any:
    if isinstance(value, (int, float)):
        return float(value) + 0.0  # 1 equals 1.0, and -0.0 equals 0.0
    if is_dataclass(value):
        shown = {part: getattr(value, part.name) for part in fields(value)}
        return {
            part.name: item if "int" in str(part.type) else _canonical(item)
            for part, item in shown.items()
            if not (part.metadata.get("later") and item == part.default)
        }
    if isinstance(value, (list, tuple)):
        return [_canonical(item) for item in value]
    return value
