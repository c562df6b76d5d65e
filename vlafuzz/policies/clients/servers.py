"""Policies that are named by the address of a model server, or by a folder, with options after a ``?``."""

import importlib
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, cast
from urllib.parse import parse_qsl, urlsplit

from pydantic import ValidationError

from vlafuzz.common.reading import first_problem
from vlafuzz.errors import PrerequisiteError, UsageError, install, suggestion
from vlafuzz.policies.base import Policy, PolicySpec
from vlafuzz.policies.clients.options import CommonOptions, profile_options

# Named protocol:address, or just by the address for HTTP; each is imported when it is asked for.
SERVERS = {
    "vla-eval": "vlafuzz.policies.clients.vla_eval:VlaEval",
    "openpi": "vlafuzz.policies.clients.openpi:OpenPi",
    "http": "vlafuzz.policies.clients.openvla:OpenVla",
    "groot": "vlafuzz.policies.clients.groot:Groot",
    "lerobot": "vlafuzz.policies.clients.lerobot:LeRobot",  # a folder, named in the same way
}


@dataclass(frozen=True)
class Address:
    """The address of a model server. ``name`` is what the user wrote, without the options."""

    name: str
    url: str
    options: Any


class Client(Protocol):
    """The class of a policy behind a model server.

    ``form`` shows how users name it. ``options``: a class of ``CommonOptions``. Without ``schemes``, the policy is in a
    folder instead of at an address. With ``answers_batches`` set, its servers answer several observations in one call
    of the model.
    """

    form: str
    schemes: Sequence[str]
    options: Any

    def __call__(self, address: Any) -> Policy:
        """Connect to a server; PrerequisiteError when none answers, UsageError when it is not supported."""


def client(protocol: str) -> Client:
    """The class of policies that speak a protocol, a key of ``SERVERS``."""
    module, _, name = SERVERS[protocol].partition(":")
    return cast(Client, getattr(importlib.import_module(module), name))


def client_of(name: str) -> Client | None:
    """The class of the policy of that name; None where it is not behind a server or in a folder."""
    protocol, colon, _ = name.partition(":")
    protocol = "http" if protocol == "https" else protocol
    return client(protocol) if colon and protocol in SERVERS else None


def address_of(name: str) -> Address | None:
    """The address in a policy's name, validated; connects to nothing. None for policies without one."""
    kind = client_of(name)
    return None if kind is None else parse(name, kind)


def options_of(name: str) -> CommonOptions | None:
    """The options in the name of a policy behind a server or from a folder."""
    return getattr(address_of(name), "options", None)


def names_its_model(name: str) -> bool:
    """Whether a policy's name says which model it is; an address or a folder does with a ``version``."""
    options = options_of(name)
    return options is None or options.version is not None


def guesses(name: str, spec: PolicySpec) -> dict[str, str]:
    """The conventions of a policy behind a server or in a folder that nobody declares: ``CommonOptions.guesses``."""
    options = options_of(name)
    return {} if options is None else options.guesses(spec)


def is_remote(policy: Policy) -> bool:
    return bool(getattr(policy, "schemes", ()))


@contextmanager
def needed(name: str, *packages: str, hint: str | None = None) -> Iterator[None]:
    """Import these packages and those of the block; else a PrerequisiteError, by default about the extra remote."""
    try:
        for package in packages:
            importlib.import_module(package)
        yield
    except ModuleNotFoundError as error:
        message = f"{name} needs the package {error.name!r}"
        raise PrerequisiteError(message, hint=hint or install("remote")) from None


def parse(name: str, kind: Client) -> Address:
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
    given: dict[str, Any] = dict(pairs)
    keys = [key for key, _ in pairs]
    if twice := sorted(key for key in given if keys.count(key) > 1):
        raise UsageError(f"{name!r}: {twice[0]} is given twice", hint="give it once")
    if "profile" in given:
        given = {**profile_options(given["profile"], kind.options.protocol), **given}
    try:
        options: CommonOptions = kind.options.model_validate(given)
    except ValidationError as error:
        raise _explained(name, kind.options, error) from None
    for problem, hint in options.refusals():
        raise UsageError(f"{name!r}: {problem}", hint=hint)
    return options


def _explained(name: str, kind: type[CommonOptions], error: ValidationError) -> UsageError:
    """Pydantic's first error as one sentence with the option and its value."""
    first: Any = error.errors(include_url=False)[0]
    option, value = str(first["loc"][0]), first["input"]
    if first["type"] == "extra_forbidden":
        return UsageError(f"{name!r}: unknown option {option!r}", suggestion(option, kind.model_fields))
    if first["type"] == "literal_error":
        known = re.findall(r"'([^']+)'", first["ctx"]["expected"])
        return UsageError(f"{name!r}: unknown {option} {value!r}", suggestion(str(value), known))
    return UsageError(f"{name!r}: {first_problem(error)}")
