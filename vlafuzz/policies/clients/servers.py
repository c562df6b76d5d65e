"""Model servers by protocol: policies that are named by an address or a folder."""

import importlib
from typing import Any, cast

from vlafuzz.policies.base import Policy, PolicySpec
from vlafuzz.policies.clients import remote
from vlafuzz.policies.clients.remote import Address, Client, CommonOptions

# Named protocol:address, or just by the address for HTTP; each is imported when it is asked for.
SERVERS = {
    "vla-eval": "vlafuzz.policies.clients.vla_eval:VlaEval",
    "openpi": "vlafuzz.policies.clients.openpi:OpenPi",
    "http": "vlafuzz.policies.clients.openvla:OpenVla",
    "groot": "vlafuzz.policies.clients.groot:Groot",
    "lerobot": "vlafuzz.policies.clients.lerobot:LeRobot",  # a folder, named in the same way
}


def client(protocol: str) -> Client:
    """The class of policies that speak a protocol, a key of ``SERVERS``."""
    module, _, name = SERVERS[protocol].partition(":")
    return cast(Client, getattr(importlib.import_module(module), name))


def client_of(name: str) -> Client | None:
    """The class of the policy of that name; None where it is not behind a server or in a folder."""
    protocol, colon, _ = name.partition(":")
    protocol = "http" if protocol == "https" else protocol
    return client(protocol) if colon and protocol in SERVERS else None


def address_of(name: str) -> Address[Any] | None:
    """The address in a policy's name, validated; connects to nothing. None for policies without one."""
    kind = client_of(name)
    return None if kind is None else remote.parse(name, kind)


def options_of(name: str) -> CommonOptions | None:
    """The options in the name of a policy behind a server or from a folder."""
    address = address_of(name)
    return None if address is None else cast(CommonOptions, address.options)


def names_its_model(name: str) -> bool:
    """Whether a policy's name says which model it is; an address or a folder does with a ``version``."""
    options = options_of(name)
    return options is None or options.version is not None


def guesses(name: str, spec: PolicySpec) -> dict[str, str]:
    """For a policy behind a server or from a folder, see ``clients.remote.guesses``."""
    options = options_of(name)
    return {} if options is None else remote.guesses(options, spec)


def is_remote(policy: Policy) -> bool:
    """Whether the policy is behind a model server."""
    return bool(getattr(policy, "schemes", ()))


def answers_batches(policy: Policy) -> bool:
    """Whether the policy is behind a server that answers several observations in one call of its model."""
    return bool(getattr(policy, "answers_batches", False))
