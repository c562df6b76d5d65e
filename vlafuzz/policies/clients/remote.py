"""Addresses of model servers, ``protocol:scheme://host:port``, with options that describe the model."""

import hashlib
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, Literal, Protocol, TypeVar
from urllib.parse import parse_qsl, urlsplit

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from vlafuzz.errors import PrerequisiteError, UsageError, install, suggestion
from vlafuzz.policies.base import SIM_HZ, CameraRequest, Policy, PolicySpec
from vlafuzz.policies.clients.profiles import options_of

SIDE = 224  # pixels: nearly all VLAs resize their pictures to this


def size(text: object) -> object:
    """Parse ``224`` or ``320x240`` in pixels; ``0`` for no picture."""
    match = re.fullmatch(r"(\d{1,4})(?:x(\d{1,4}))?", str(text))
    pixels = (int(match[1]), int(match[2] or match[1])) if match else (0, 1)
    if pixels != (0, 0) and min(pixels) < 16:
        raise ValueError(f"expected pixels as 224 or 320x240, or 0 for none, got {text!r}")
    return pixels


def divisor(hz: int) -> int:
    """``hz`` if it divides the simulator's rate, else ValueError."""
    if hz < 1 or SIM_HZ % hz:
        raise ValueError(f"expected a divisor of {SIM_HZ}, got {hz}")
    return hz


# Layouts of proprioception by vla-eval's names, see ``conventions.LAYOUTS``.
State = Literal[
    "0",
    "1",
    "eef_pos3_axisangle3_gripper1",
    "eef_pos3_axisangle3_gripper2",
    "eef_pos3_quat4_gripper1",
    "eef_pos3_rpy3_pad1_gripper1",
]
Scale = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Size = Annotated[tuple[int, int], BeforeValidator(size)]


class CommonOptions(BaseModel):
    """The options of every server's model; see ``ActionSpec`` and ``PolicySpec``.

    Attributes:
        version: which model it is, so that stored outcomes of that one answer; changes nothing else.
        profile: name or file of a profile, which sets the options of a known model.
        camera: width and height of the third-person picture; (0, 0) for none.
        wrist: whether a wrist picture comes second.
        execute: actions of a chunk to execute before the next request; None for all of them.
        deterministic: the same observations and seed give the same actions; servers do not declare this.
        batch: the largest number of observations sent at once.
        timeout: seconds to wait for a reply, times the number of observations sent at once.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    protocol: ClassVar[str]

    version: str | None = Field(default=None, pattern=r"^[\w.:@+/-]{1,100}$")
    profile: str | None = None
    camera: Size | None = None
    wrist: bool | None = None
    gripper: Literal["open_positive", "close_positive", "open_01", "close_01"] | None = None
    position_scale: Scale = 1.0
    relative_to: Literal["target", "current"] = "target"
    sticky: int = Field(default=0, ge=0)
    execute: Annotated[
        Annotated[int, Field(ge=1)] | None, BeforeValidator(lambda text: None if text == "all" else text)
    ] = None
    deterministic: bool = False
    batch: int = Field(default=16, ge=1)
    timeout: float = Field(default=60.0, gt=0, le=86400)

    def provenance(self) -> dict[str, str]:
        """The profile, with a digest of all options that follow from it: a file of one may be edited."""
        if self.profile is None:
            return {"profile": "none"}
        options = self.model_dump_json(exclude={"version", "timeout"})
        return {
            "profile": self.profile,
            "options": hashlib.blake2b(options.encode(), digest_size=6).hexdigest(),
        }

    def refusals(self) -> list[tuple[str, str]]:
        """Options that cannot be executed or sent, each as a message and a hint."""
        return []


class VlaEvalOptions(CommonOptions):
    """Options of a model that declares itself. None means as declared, or else the default.

    Attributes:
        state: ``0``, ``1`` (the layout that the server declares) or the name of a layout.
        action: the only kind of vla-eval's actions that can be executed.
        frame: of deltas: the robot's base.
        benchmark: the one of vla-eval's own benchmarks that sends the same: it names pictures, and sends
            proprioception and the wrist picture to servers that ask for them.
    """

    protocol: ClassVar[str] = "vla-eval"

    state: State | None = None
    benchmark: Literal["libero"] | None = None
    action: Literal["eef_delta"] = "eef_delta"
    frame: Literal["base"] = "base"
    rotation: Literal["axis_angle", "euler_xyz", "rpy"] | None = None
    rotation_scale: Scale = 1.0
    hz: Annotated[int, AfterValidator(divisor)] = 5


Options = TypeVar("Options", bound=CommonOptions)


@dataclass(frozen=True)
class Address(Generic[Options]):
    """The address of a model server. ``name`` is what the user wrote, without the options."""

    name: str
    url: str
    options: Options


class Client(Protocol):
    """The class of a policy behind a model server.

    ``form`` shows how users name it. ``options``: a class of ``CommonOptions``. Without
    ``schemes``, the policy is in a folder instead of at an address. With ``answers_batches`` set, its
    servers answer several observations in one call of the model.
    """

    form: str
    schemes: Sequence[str]
    options: Any

    def __call__(self, address: Any) -> Policy:
        """Connect to a server; PrerequisiteError when none answers, UsageError when it is not supported."""


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


def guesses(options: CommonOptions, spec: PolicySpec) -> dict[str, str]:
    """Conventions that neither the options nor the server declare, ``option=value``, and what that means."""
    given = options.model_fields_set | {name for name, by in spec.provenance.items() if by == "server"}
    values = vars(options) | vars(spec.action)
    assumed = {name: means for name, means in CONVENTIONS.items() if name in values and name not in given}
    plain = {name: f"{value:g}" if isinstance(value, float) else str(value) for name, value in values.items()}
    return {f"{name}={plain[name]}": means for name, means in assumed.items()}


def cameras_of(
    size: tuple[int, int], wrist_size: tuple[int, int] | None = None, *, wrist: bool
) -> tuple[CameraRequest, ...]:
    """The cameras: third-person, unless ``size`` is (0, 0), then wrist, by default of the same size."""
    cameras = [CameraRequest("front", *size)] if size != (0, 0) else []
    if wrist:
        cameras.append(
            CameraRequest("wrist", *(wrist_size or (size if cameras else (SIDE, SIDE))), role="wrist")
        )
    return tuple(cameras)


@contextmanager
def needed(name: str, hint: str | None = None) -> Iterator[None]:
    """Import optional packages in this block; else a PrerequisiteError, by default about the extra remote."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise PrerequisiteError(
            f"{name} needs the package {error.name!r}", hint=hint or install("remote")
        ) from None


def parse(name: str, kind: Client) -> Address[Any]:
    """Parse and validate an address, or raise UsageError; connects to nothing, and opens no folder."""
    protocol, _, rest = name.partition(":")
    form = f"expected {kind.form}?option=value&…"
    if not kind.schemes:
        folder, _, query = rest.partition("?")
        if not folder:
            raise UsageError(f"{name!r} names no folder", hint=form)
        return Address(f"{protocol}:{folder}", folder, _options(name, kind, query))
    prefix = "" if rest.startswith("//") else f"{protocol}:"  # else the address is the name
    rest = name.removeprefix(prefix)
    try:
        parts = urlsplit(rest)
        complete = parts.scheme in kind.schemes and parts.hostname and parts.port
    except ValueError as error:
        raise UsageError(f"{name!r}: {error}", hint=form) from None
    if not complete or parts.fragment:
        raise UsageError(f"{name!r} is no address of a server", hint=form)
    if parts.username is not None or parts.password is not None:
        message = f"the address of {parts.hostname!r} has a password"
        raise UsageError(message, hint="leave it out: stores keep names")
    url = rest.partition("?")[0]
    return Address(f"{prefix}{url}", url, _options(name, kind, parts.query))


def _options(name: str, kind: Client, query: str) -> CommonOptions:
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError as error:
        raise UsageError(f"{name!r}: {error}", hint=f"expected {kind.form}?option=value&…") from None
    keys = [key for key, _ in pairs]
    if twice := sorted({key for key in keys if keys.count(key) > 1}):
        raise UsageError(f"{name!r}: {twice[0]} is given twice", hint="give it once")
    given: dict[str, Any] = dict(pairs)
    if "profile" in given:
        given = {**options_of(given["profile"], kind.options.protocol), **given}
    try:
        options: CommonOptions = kind.options.model_validate(given)
    except ValidationError as error:
        raise _explain(name, kind.options, error) from None
    for problem, hint in options.refusals():
        raise UsageError(f"{name!r}: {problem}", hint=hint)
    return options


def _explain(name: str, kind: type[CommonOptions], error: ValidationError) -> UsageError:
    """Pydantic's first error as one sentence with the option and its value."""
    first: Any = error.errors(include_url=False)[0]
    option, value = str(first["loc"][0]), first["input"]
    if first["type"] == "extra_forbidden":
        return UsageError(f"{name!r}: unknown option {option!r}", suggestion(option, kind.model_fields))
    if first["type"] == "literal_error":
        known = re.findall(r"'([^']+)'", first["ctx"]["expected"])
        return UsageError(f"{name!r}: unknown {option} {value!r}", suggestion(str(value), known))
    if first["type"] == "value_error":
        return UsageError(f"{name!r}: {option}: {first['ctx']['error']}")
    message = first["msg"].partition(",")[0]
    return UsageError(f"{name!r}: {option}: {message[0].lower()}{message[1:]}, got {value!r}")
