"""Policies by name: built in, a world's own, behind a model server, or the user's own."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from vlafuzz.common.plugins import OBJECT, PREFIX, is_reference, load_factory, make_of
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.policies.base import Policy, PolicySpec
from vlafuzz.policies.clients.servers import SERVERS, address_of, client, client_of
from vlafuzz.policies.controls import Frozen, Random
from vlafuzz.worlds import known_worlds, world_of

Factory = Callable[..., Policy]
CONTROLS: dict[str, Factory] = {"random": Random, "frozen": Frozen}


def built_in() -> dict[str, Factory]:
    """The policies that come with vlafuzz and its worlds, by name; some take a folder with other weights."""
    policies = dict[str, Factory]()
    for world in known_worlds().values():
        policies |= world.policies
    return policies | CONTROLS


def is_built_in(name: str) -> bool:
    """Whether a policy is one of ours, with whatever weights."""
    return _built_in(name) is not None


def known_policies() -> dict[str, str]:
    """Name → description, one sentence each."""
    named: dict[str, Any] = built_in() | {kind.form: kind for kind in map(client, SERVERS)}
    return {name: (inspect.getdoc(make) or "").split("\n\n")[0].replace("\n", " ") for name, make in named.items()}


def check_policy_name(name: str) -> None:
    """Raise UsageError for a name that ``make_policy`` does not know. Connects to no server."""
    if is_reference(name):
        load_factory(name)
    elif name.startswith(OBJECT):
        hint = "hand it over again, see vlafuzz.api, or name a factory: python:pkg.mod:factory"
        raise UsageError(f"policy {name!r} is an object that was handed over in Python", hint=hint)
    elif client_of(name):
        address_of(name)
    elif name in SERVERS:
        form = client(name).form
        raise UsageError(f"unknown policy {name!r}: no address", hint=f"expected {form}?option=value&…")
    elif not is_built_in(name):
        near = suggestion(name.partition(":")[0], [*built_in(), *SERVERS])
        raise UsageError(f"unknown policy {name!r}", hint=f"{near} your own: python:pkg.mod:factory")


def is_shared(name: str) -> bool:
    """Whether all workers share one policy of that name (see ``Policy``), which is not created."""
    check_policy_name(name)
    factory = load_factory(name) if is_reference(name) else client_of(name) or built_in().get(name)
    return bool(getattr(factory, "shared", False))


def make_policy(name: str, task: str = "") -> Policy:
    """The policy of that name in a task; a UsageError if there is none, a PrerequisiteError if it does not answer."""
    check_policy_name(name)
    if world := experts_world(name, task):
        if expert := world_of(task).solvers().get("expert"):
            return expert
        raise UsageError(f"policy {name!r}: {world} has no expert", hint="define solve(now), or name a policy of yours")
    if kind := client_of(name):
        return kind(address_of(name))
    if make := _built_in(name):
        return make()
    policy = make_of(name)
    if not isinstance(getattr(policy, "spec", None), PolicySpec):
        message = f"{name!r} made a {type(policy).__name__}, which has no spec"
        raise UsageError(message, hint="see vlafuzz.policies.base.Policy")
    return cast(Policy, policy)


def experts_world(name: str, task: str) -> str:
    """The reference of the user's own world whose expert a policy's name means in a task; empty for other policies."""
    world = task.rpartition("/")[0]
    return world if name == "expert" and is_reference(world) else ""


def _built_in(name: str) -> Callable[[], Policy] | None:
    """What makes one of our policies: NAME, or NAME:FOLDER where it takes a folder with other weights."""
    name, colon, folder = name.partition(":")
    factory = None if f"{name}:" == PREFIX else built_in().get(name)  # which loads our worlds
    if factory is None or not colon:
        return factory
    if not inspect.signature(factory).parameters:
        return None
    return lambda: factory(Path(folder).expanduser())
