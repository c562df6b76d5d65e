"""Model servers: where one is, ``protocol:scheme://host:port``, and options that say what its model is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Protocol
from urllib.parse import parse_qsl, urlsplit

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.subjects.base import Subject

INSTALL = "pip install 'vlafuzz[remote]'"
_SIM_HZ = 100


def _size(text: object) -> object:
    """``224`` and ``320x240`` in pixels; ``0`` for no picture."""
    found = re.fullmatch(r"(\d{1,4})(?:x(\d{1,4}))?", str(text))
    size = (int(found[1]), int(found[2] or found[1])) if found else (0, 1)
    if size != (0, 0) and min(size) < 16:
        raise ValueError(f"expected pixels as 224 or 320x240, or 0 for none, got {text!r}")
    return size


def _divisor(hz: int) -> int:
    if hz < 1 or _SIM_HZ % hz:
        raise ValueError(f"expected a divisor of {_SIM_HZ}, got {hz}")
    return hz


def _all(text: object) -> object:
    return None if text == "all" else text


# Layouts of proprioception, in vla-eval's words.
State = Literal[
    "0", "1", "eef_pos3_axisangle3_gripper1", "eef_pos3_axisangle3_gripper2", "eef_pos3_quat4_gripper1"
]
Scale = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Options(BaseModel):
    """What the user says about a model. None: as its server declares it, else the default.

    Attributes:
        camera: width and height of the third-person picture; (0, 0) for none.
        wrist: whether a picture of the same size from the wrist comes second.
        state: ``0``, ``1`` (in the layout that the server declares) or the name of a layout.
        rotation: as in ``ActionSpec``; so are the scales, ``relative_to``, ``gripper``, ``sticky``, ``hz``.
        execute: actions of a chunk to execute before asking again; None for all of them.
        deterministic: same observations and seed, same actions: no server can be trusted to say so.
        batch: most observations that are sent at once.
        timeout: seconds to wait for a reply; for n replies to what was sent at once, n times that.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: Annotated[tuple[int, int], BeforeValidator(_size)] | None = None
    wrist: bool | None = None
    state: State | None = None
    rotation: Literal["axis_angle", "euler_xyz", "rpy"] | None = None
    gripper: Literal["open_positive", "close_positive", "open_01", "close_01"] | None = None
    position_scale: Scale = 1.0
    rotation_scale: Scale = 1.0
    relative_to: Literal["target", "current"] = "target"
    sticky: int = Field(0, ge=0)
    hz: Annotated[int, AfterValidator(_divisor)] = 5
    execute: Annotated[Annotated[int, Field(ge=1)] | None, BeforeValidator(_all)] = None
    deterministic: bool = False
    batch: int = Field(16, ge=1)
    timeout: float = Field(60.0, gt=0, le=86400)


@dataclass(frozen=True)
class Address:
    """A model server by address. ``name`` is what the user wrote, up to the options."""

    name: str
    url: str
    options: Options


class Remote(Subject, Protocol):
    """A subject behind a model server. ``form`` is how it is named; making it connects, naming it does not.

    Raises:
        PrerequisiteError: no server, or a package to install.
        UsageError: the server declares what is not supported.
    """

    form: ClassVar[str]
    schemes: ClassVar[Sequence[str]]

    def __init__(self, address: Address) -> None: ...


def parse(name: str, kind: type[Remote]) -> Address:
    """An address, all of it checked; nothing is connected.

    Raises:
        UsageError: not of that form, an unknown option, or a value that an option does not have.
    """
    prefix, _, rest = name.partition(":")
    try:
        parts = urlsplit(rest)
        complete = parts.scheme in kind.schemes and parts.hostname and parts.port
        options = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError as error:
        raise UsageError(f"{name!r}: {error}", hint=f"expected {kind.form}?option=value&…") from None
    if not complete or parts.fragment:
        raise UsageError(f"{name!r} is no address of a server", hint=f"expected {kind.form}?option=value&…")
    if parts.username is not None or parts.password is not None:
        raise UsageError(
            f"the address of {parts.hostname!r} has a password", hint="stores keep names: leave it"
        )
    url = rest.partition("?")[0]
    return Address(f"{prefix}:{url}", url, _options(name, options))


def _options(name: str, given: Sequence[tuple[str, str]]) -> Options:
    keys = [key for key, _ in given]
    if twice := sorted({key for key in keys if keys.count(key) > 1}):
        raise UsageError(f"{name!r}: {twice[0]} is given twice", hint="give it once")
    try:
        return Options.model_validate(dict(given))
    except ValidationError as error:
        raise _explain(name, error) from None


def _explain(name: str, error: ValidationError) -> UsageError:
    """Pydantic's first complaint as one sentence with the option and its value."""
    first: Any = error.errors(include_url=False)[0]
    option = str(first["loc"][0])
    if first["type"] == "extra_forbidden":
        return UsageError(f"{name!r}: unknown option {option!r}", suggestion(option, Options.model_fields))
    if first["type"] == "literal_error":
        known = re.findall(r"'([^']+)'", first["ctx"]["expected"])
        return UsageError(f"{name!r}: unknown {option} {first['input']!r}", suggestion(first["input"], known))
    if first["type"] == "value_error":
        return UsageError(f"{name!r}: {option}: {first['ctx']['error']}")
    told = first["msg"].partition(",")[0]
    return UsageError(f"{name!r}: {option}: {told[0].lower()}{told[1:]}, got {first['input']!r}")
