"""Options in the names of policies behind servers and in folders, and profiles: the options of known models."""

import hashlib
import math
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.policies.base import SIM_HZ, Gripper, PolicySpec, Relative, Rotation
from vlafuzz.policies.clients.conventions import OWN

PROFILES = Path(__file__).parent / "profiles"
SIDE = 224  # pixels: nearly all VLAs resize their pictures to this
# Options that are guessed where nobody gives them: what the default means. A wrong one makes any model fail.
CONVENTIONS = {
    "action": "actions move the hand",
    "frame": "along the axes of the robot's base",
    "rotation": "turns are rotation vectors",
    "gripper": "it opens above 0",
    "relative_to": "a move starts at the last target, not at the hand",
    "position_scale": "a unit is a metre",
    "rotation_scale": "a unit is a radian",
    "hz": "actions a second",
}


def _size(text: object) -> object:
    """Parse ``224`` or ``320x240`` in pixels; ``0`` for no picture."""
    match = re.fullmatch(r"(\d{1,4})(?:x(\d{1,4}))?", str(text))
    pixels = (int(match[1]), int(match[2] or match[1])) if match else (0, 1)
    if pixels != (0, 0) and min(pixels) < 16:
        raise ValueError(f"expected pixels as 224 or 320x240, or 0 for none, got {text!r}")
    return pixels


def _divisor(hz: int) -> int:
    if hz < 1 or SIM_HZ % hz:
        raise ValueError(f"expected a divisor of {SIM_HZ}, got {hz}")
    return hz


def _signed(scale: float) -> float:
    """A scale may be negative, for models trained with a controller that turns the wrong way."""
    if not math.isfinite(scale) or scale == 0:
        raise ValueError(f"expected a number other than 0, got {scale}")
    return scale


def _benchmark(name: str) -> str:
    """One of vla-eval's benchmarks that a profile names."""
    declared = (profile.protocols.get("vla-eval", {}) for profile in known_profiles().values())
    known = {str(options["benchmark"]) for options in declared if "benchmark" in options}
    if name not in known:
        raise ValueError(f"expected {', '.join(known)}, got {name!r}")
    return name


# Layouts of proprioception by vla-eval's names, see ``conventions.LAYOUTS``.
_Layout = Literal[
    "eef_pos3_axisangle3_gripper1",
    "eef_pos3_axisangle3_gripper2",
    "eef_pos3_quat4_gripper1",
    "eef_pos3_rpy3_pad1_gripper1",
]
State = Literal["0", "1", _Layout]
Scale = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Size = Annotated[tuple[int, int], BeforeValidator(_size)]
Hertz = Annotated[int, AfterValidator(_divisor)]
_Count = Annotated[int, Field(ge=1)]


class CommonOptions(BaseModel):
    """The options of every server's model; docs/servers.md has a row for each.

    ``camera`` is (width, height), (0, 0) for none; ``execute`` is None for all actions of a chunk; ``timeout`` is in
    seconds, for each of the observations sent at once.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)  # most commands use none of them
    protocol: ClassVar[str]

    version: str | None = Field(default=None, pattern=r"^[\w.:@+/-]{1,100}$")
    profile: str | None = None
    camera: Size | None = None
    wrist: bool | None = None
    gripper: Gripper | None = None
    position_scale: Scale = 1.0
    relative_to: Relative = "target"
    sticky: int = Field(default=0, ge=0)
    execute: Annotated[_Count | None, BeforeValidator(lambda text: None if text == "all" else text)] = None
    deterministic: bool = False
    batch: _Count = 16
    timeout: float = Field(default=60.0, gt=0, le=86400)

    def provenance(self) -> dict[str, str]:
        """The profile, with a digest of all options that follow from it: a file of one may be edited."""
        if self.profile is None:
            return {"profile": "none"}
        options = self.model_dump_json(exclude={"version", "timeout"}).encode()
        return {"profile": self.profile, "options": hashlib.blake2b(options, digest_size=6).hexdigest()}

    def refusals(self) -> list[tuple[str, str]]:
        """Options that cannot be executed or sent, each as a message and a hint."""
        return []

    def guesses(self, spec: PolicySpec) -> dict[str, str]:
        """Conventions that neither options nor server declare: ``option=value``, and what it means."""
        given = self.model_fields_set | {name for name, by in spec.provenance.items() if by == "server"}
        values = vars(self) | vars(spec.action)
        return {
            f"{name}={values[name]:g}" if isinstance(values[name], float) else f"{name}={values[name]}": means
            for name, means in CONVENTIONS.items()
            if name in values and name not in given
        }


class VlaEvalOptions(CommonOptions):
    """Options of a model that declares itself. None means as declared, or else the default.

    ``benchmark``: the one of vla-eval's own benchmarks that sends the same: it names pictures, and sends proprioception
    and the wrist picture to servers that ask for them.
    """

    protocol: ClassVar[str] = "vla-eval"

    state: State | None = None
    benchmark: Annotated[str, AfterValidator(_benchmark)] | None = None
    action: Literal["eef_delta"] = "eef_delta"
    frame: Literal["base"] = "base"
    rotation: Rotation | None = None
    rotation_scale: Scale = 1.0
    hz: Hertz = 5


class ProfiledOptions(CommonOptions):
    """Options of a model whose server declares nothing, from a profile or from the user.

    ``chunk``: actions in every reply, None for any number. ``image_key`` and the others are keys in messages.
    """

    state: State = "0"
    action: Literal["eef_delta"] = "eef_delta"
    frame: Literal["base"] = "base"
    rotation: Rotation = "axis_angle"
    rotation_scale: Annotated[float, AfterValidator(_signed)] = 1.0
    hz: Hertz = 5
    chunk: _Count | None = None
    wrist_camera: Size | None = None
    image_key: str = "image"
    wrist_key: str = "wrist_image"
    state_key: str = "state"
    instruction_key: str = "instruction"

    @property
    def layout(self) -> str | None:
        """The layout in which proprioception is sent; None when it is not sent."""
        return {"0": None, "1": OWN}.get(self.state, self.state)

    def refusals(self) -> list[tuple[str, str]]:
        if self.chunk and (self.execute or 0) > self.chunk:
            return [(f"execute={self.execute} of a chunk of {self.chunk}", f"execute at most {self.chunk}")]
        return []


class Profile(BaseModel, extra="forbid", frozen=True):
    """A kind of model. ``protocols``: overriding and additional options by protocol."""

    about: str
    source: str
    options: Mapping[str, Any]
    protocols: Mapping[str, Mapping[str, Any]]


@cache
def known_profiles() -> Mapping[str, Profile]:
    return {path.stem: load_profile(path) for path in sorted(PROFILES.glob("*.yaml"))}


def load_profile(path: Path) -> Profile:
    """Read a profile from a file; UsageError when this fails."""
    content = read_yaml(path, UsageError, hint="name a profile, or a file of one")
    hint = f"it has the keys {', '.join(Profile.model_fields)}: see those in {PROFILES}"
    return validated(Profile, content, path, UsageError, hint)


def profile_options(name: str, protocol: str) -> Mapping[str, Any]:
    """The options for a protocol in a profile, a built-in one or a ``.yaml`` file; UsageError when none."""
    known = known_profiles()
    if not name.endswith((".yaml", ".yml")) and name not in known:
        raise UsageError(f"unknown profile {name!r}", hint=f"{suggestion(name, known)} or a file: mine.yaml")
    profile = known[name] if name in known else load_profile(Path(name))
    if protocol not in profile.protocols:
        message = f"the profile {name!r} says nothing about {protocol}"
        raise UsageError(message, hint=f"it covers {', '.join(profile.protocols)}")
    options = {**profile.options, **profile.protocols[protocol]}
    if "profile" in options:
        raise UsageError(f"the profile {name!r} names another one", hint="leave that out")
    return options
