"""Policies by name: built in, behind a model server, or the user's own."""

import importlib
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import OBJECT, is_reference, load_factory, make_of
from vlafuzz.policies.base import Policy, PolicySpec
from vlafuzz.policies.controls import Frozen, Random
from vlafuzz.policies.expert import Expert
from vlafuzz.policies.pinhole import Pinhole
from vlafuzz.policies.seeing import SeeingExpert


def _mini(folder: Path | None = None) -> Policy:
    """A small learned vision-language-action model that runs on a CPU; mini:FOLDER has other weights."""
    from vlafuzz.policies.mini.policy import SHIPPED, Mini

    return Mini(folder or SHIPPED)


POLICIES: dict[str, Callable[[], Policy]] = {
    "mini": _mini,
    "pinhole": Pinhole,
    "expert": Expert,
    "seeing": SeeingExpert,
    "random": Random,
    "frozen": Frozen,
}
# Policies of other worlds than the tabletop, by module and name.
OF_WORLDS = {
    "mini-libero": "vlafuzz.policies.mini.policy:mini_libero",
    "libero-expert": "vlafuzz.sim.libero.expert.policy:LiberoExpert",
}
RETRAINED = "mini:"  # and the folder of other weights for the same network
# Policies behind model servers, by protocol; named protocol:address, or just by the address for HTTP.
SERVERS = {
    "vla-eval": "vlafuzz.clients.vla_eval:VlaEval",
    "openpi": "vlafuzz.clients.openpi:OpenPi",
    "http": "vlafuzz.clients.openvla:OpenVla",
    "groot": "vlafuzz.clients.groot:Groot",
    "lerobot": "vlafuzz.clients.lerobot:LeRobot",  # a folder instead of a server, named in the same way
}


class Client(Protocol):
    """The class of a policy behind a model server.

    ``form`` shows how users name it. ``options``: a class of ``clients.remote.CommonOptions``. Without
    ``schemes``, the policy is in a folder instead of at an address. With ``answers_batches`` set, its
    servers answer several observations in one call of the model.
    """

    form: str
    schemes: Sequence[str]
    options: Any

    def __call__(self, address: Any) -> Policy:
        """Connect to a server; PrerequisiteError when none answers, UsageError when it is not supported."""


def client(protocol: str) -> Client:
    """The class of policies that speak a protocol, a key of ``SERVERS``."""
    return cast(Client, _named(SERVERS[protocol]))


def _named(place: str) -> Any:
    """What stands at ``module:name``. The layers import it after policies, so only when it is asked for."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


def is_built_in(name: str) -> bool:
    """Whether a policy is one of ours, with whatever weights."""
    return name in POLICIES or name in OF_WORLDS or name.startswith(RETRAINED)


def known_policies() -> dict[str, str]:
    """Name → description, one sentence each."""
    clients = [client(protocol) for protocol in SERVERS]
    others = {name: _named(place) for name, place in OF_WORLDS.items()}
    named = POLICIES | others | {kind.form: kind for kind in clients}
    return {
        name: (inspect.getdoc(factory) or "").split("\n\n")[0].replace("\n", " ")
        for name, factory in named.items()
    }


def check_policy_name(name: str) -> None:
    """Raise UsageError for a name that ``make_policy`` does not know. Connects to no server."""
    if is_reference(name):
        load_factory(name)
    elif name.startswith(OBJECT):
        hint = "hand it over again, see vlafuzz.api, or name a factory: python:pkg.mod:factory"
        raise UsageError(f"policy {name!r} is an object that was handed over in Python", hint=hint)
    elif kind := _server(name):
        _address(name, kind)
    elif name in SERVERS:
        form = client(name).form
        raise UsageError(f"unknown policy {name!r}: no address", hint=f"expected {form}?option=value&…")
    elif not is_built_in(name):
        near = suggestion(name.partition(":")[0], [*POLICIES, *OF_WORLDS, *SERVERS])
        raise UsageError(f"unknown policy {name!r}", hint=f"{near} your own: python:pkg.mod:factory")


def is_shared(name: str) -> bool:
    """Whether all workers share one policy of that name (see ``Policy``), which is not created."""
    check_policy_name(name)
    factory = load_factory(name) if is_reference(name) else _server(name) or POLICIES.get(name)
    return bool(getattr(factory, "shared", False))


def names_its_model(name: str) -> bool:
    """Whether a policy's name says which model it is; an address or a folder does with a ``version``."""
    kind = _server(name)
    return kind is None or _address(name, kind).options.version is not None


def options_of(name: str) -> Any | None:
    """The ``clients.remote.CommonOptions`` in the name of a policy behind a server or from a folder."""
    kind = _server(name)
    return None if kind is None else _address(name, kind).options


def guesses(name: str, spec: PolicySpec) -> dict[str, str]:
    """For a policy behind a server or from a folder, see ``clients.remote.guesses``."""
    kind = _server(name)
    if kind is None:
        return {}
    say: Callable[[Any, PolicySpec], dict[str, str]] = importlib.import_module(
        "vlafuzz.clients.remote"
    ).guesses
    return say(_address(name, kind).options, spec)


def is_remote(policy: Policy) -> bool:
    """Whether the policy is behind a model server."""
    return bool(getattr(policy, "schemes", ()))


def answers_batches(policy: Policy) -> bool:
    """Whether the policy is behind a server that answers several observations in one call of its model."""
    return bool(getattr(policy, "answers_batches", False))


def make_policy(name: str) -> Policy:
    """The policy of that name.

    Raises:
        UsageError: there is no such policy, or the factory returns something else.
        PrerequisiteError: no server answers, or the user's code raises.
    """
    check_policy_name(name)
    if kind := _server(name):
        return kind(_address(name, kind))
    if name.startswith(RETRAINED):
        return _mini(Path(name.removeprefix(RETRAINED)).expanduser())
    if name in OF_WORLDS:
        return cast(Policy, _named(OF_WORLDS[name])())
    if not is_reference(name):
        return POLICIES[name]()
    policy = make_of(name)
    if not isinstance(getattr(policy, "spec", None), PolicySpec):
        message = f"{name!r} made a {type(policy).__name__}, which has no spec"
        raise UsageError(message, hint="see vlafuzz.policies.base.Policy")
    return cast(Policy, policy)


def _server(name: str) -> Client | None:
    protocol, colon, _ = name.partition(":")
    protocol = "http" if protocol == "https" else protocol
    return client(protocol) if colon and protocol in SERVERS else None


def _address(name: str, kind: Client) -> Any:
    """The ``clients.remote.Address`` in a name, validated; connects to nothing."""
    parse: Callable[[str, Client], Any] = importlib.import_module("vlafuzz.clients.remote").parse
    return parse(name, kind)
